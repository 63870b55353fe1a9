// Draws one result in three dimensions: the body, bones, tool and named points, at any moment between its frames.
"use strict";

const Playback = (() => {
  // Perceptually even colours (viridis), told apart with every kind of colour vision.
  const SCALE = ["#440154", "#482878", "#3e4a89", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
  const KINDS = { "<f4": Float32Array, "<i2": Int16Array, "<u1": Uint8Array, "<u4": Uint32Array };
  // Directions from the body to the eye; x points back, y to the speaker's right, z up.
  const VIEWS = { side: [0, -1, 0.0001], oblique: [-0.75, -1, 0.45], front: [-1, 0, 0.0001], top: [0, -0.0001, 1], back: [1, 0, 0.0001] };

  // Unpacks the block of a result: its header, and its arrays by name.
  async function unpack(base64) {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const block = await new Response(stream).arrayBuffer();
    const size = new DataView(block).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(block, 4, size)));
    const arrays = {};
    for (const [name, [kind, place, count]] of Object.entries(header.arrays)) {
      arrays[name] = new KINDS[kind](block, 4 + size + place, count);
    }
    const frames = arrays.times.length;
    for (const name of ["moved", "fibres_moved"]) if (arrays[name]) sumOverFrames(arrays[name], frames);
    for (const field of header.fields) sumOverFrames(arrays[`field_${field.name}`], frames);
    for (const part of header.context) if (part.moves) sumOverFrames(arrays[`context_${part.name}_moved`], frames);
    return { ...header, arrays, frames };
  }

  // Frames are stored as changes since the frame before; whole numbers wrap around, and so do their sums.
  function sumOverFrames(values, frames) {
    const size = values.length / frames;
    for (let k = size; k < values.length; k++) values[k] += values[k - size];
  }

  function colourOf(share) {
    const place = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
    const low = Math.min(Math.floor(place), SCALE.length - 2);
    return new THREE.Color(SCALE[low]).lerp(new THREE.Color(SCALE[low + 1]), place - low);
  }

  const LOOKUP = new Float32Array(256 * 3);
  for (let k = 0; k < 256; k++) colourOf(k / 255).toArray(LOOKUP, 3 * k);

  class Body {
    constructor(data) {
      this.data = data;
      const { arrays } = data;
      this.nodes = arrays.points.length / 3;
      this.position = new Float32Array(arrays.points);
      // What is drawn is a smooth surface, whose points are linear in the nodes.
      this.smooth = Array.from({ length: data.smooth_steps }, (_, k) => ["begin", "column", "weight"].map((name) => arrays[`smooth_${name}_${k}`]));
      this.drawn = this.spread(this.position, 3);
      this.drawnAtRest = this.drawn.slice();
      this.moved = new Float32Array(3 * this.nodes);
      // What the colours of each field span; a page with several results gives them all the same.
      this.spans = { displacement: [0, this.largestDisplacement()] };
      for (const field of data.fields) this.spans[field.name] = [field.low, field.high];
      this.frame = 0;
      this.at(0);
    }

    // Places the nodes at a frame, which need not be whole.
    at(frame) {
      const { arrays } = this.data;
      this.frame = frame;
      this.place(arrays.moved, arrays.points, this.position, this.moved);
      this.drawn.set(this.spread(this.position, 3));
    }

    // Places points at the present frame by their displacements in all frames.
    place(moves, points, position, moved = null) {
      const { rounding_mm, frames } = this.data, n = points.length / 3;
      const before = Math.min(Math.floor(this.frame), frames - 1), after = Math.min(before + 1, frames - 1), share = this.frame - before;
      for (let axis = 0; axis < 3; axis++) {
        const a = (3 * before + axis) * n, b = (3 * after + axis) * n;
        for (let k = 0; k < n; k++) {
          const u = rounding_mm * ((1 - share) * moves[a + k] + share * moves[b + k]);
          if (moved) moved[3 * k + axis] = u;
          position[3 * k + axis] = points[3 * k + axis] + u;
        }
      }
    }

    // The force of a muscle at the present frame as a share of its full force.
    pull({ times, shares }) {
      const { arrays, frames } = this.data, before = Math.min(Math.floor(this.frame), frames - 1), after = Math.min(before + 1, frames - 1);
      const now = arrays.times[before] + (this.frame - before) * (arrays.times[after] - arrays.times[before]);
      const next = times.findIndex((time) => time >= now), k = next < 0 ? times.length - 1 : Math.max(1, next), long = times[k] - times[k - 1];
      return shares[k - 1] + (long > 0 ? (shares[k] - shares[k - 1]) * Math.min(1, Math.max(0, (now - times[k - 1]) / long)) : 0);
    }

    // From values of the nodes, so many each, to those of the drawn points.
    spread(values, size) {
      for (const [begin, column, weight] of this.smooth) {
        const next = new Float32Array(size * (begin.length - 1));
        for (let row = 0; row + 1 < begin.length; row++) {
          for (let k = begin[row]; k < begin[row + 1]; k++) {
            for (let c = 0; c < size; c++) next[size * row + c] += weight[k] * values[size * column[k] + c];
          }
        }
        values = next;
      }
      return values;
    }

    largestDisplacement() {
      const { arrays, rounding_mm, frames } = this.data, n = this.nodes;
      let largest = 0;
      for (let frame = 0; frame < frames; frame++) {
        for (let k = 0; k < n; k++) {
          const place = 3 * frame * n + k;
          largest = Math.max(largest, Math.hypot(arrays.moved[place], arrays.moved[place + n], arrays.moved[place + 2 * n]));
        }
      }
      return rounding_mm * largest;
    }

    // Fills colours of the drawn points by a field.
    paint(colours, name) {
      this.spread(this.shares(name), 1).forEach((share, k) => {
        const entry = 3 * Math.round(255 * Math.min(Math.max(share, 0), 1));
        colours.set(LOOKUP.subarray(entry, entry + 3), 3 * k);
      });
    }

    // Where the nodes stand between the ends of a field; "displacement" is in the frames themselves.
    shares(name) {
      const n = this.nodes, shares = new Float32Array(n), [lowest, highest] = this.spans[name];
      if (name === "displacement") {
        for (let k = 0; k < n; k++) {
          shares[k] = Math.hypot(this.moved[3 * k], this.moved[3 * k + 1], this.moved[3 * k + 2]) / (highest || 1);
        }
        return shares;
      }
      const values = this.data.arrays[`field_${name}`], frames = this.data.frames;
      const before = Math.min(Math.floor(this.frame), frames - 1), after = Math.min(before + 1, frames - 1);
      const share = this.frame - before, own = this.data.fields.find((field) => field.name === name);
      const factor = (own.high - own.low) / (255 * (highest - lowest)), offset = (own.low - lowest) / (highest - lowest);
      for (let k = 0; k < n; k++) {
        shares[k] = offset + factor * ((1 - share) * values[before * n + k] + share * values[after * n + k]);
      }
      return shares;
    }

    // Rotation and shift of a bone at the present frame, as a matrix.
    placement(bone) {
      const matrix = new THREE.Matrix4();
      const values = this.data.arrays[`bone_${bone.name}_placement`];
      if (!bone.moves) return matrix;
      const before = Math.min(Math.floor(this.frame), this.data.frames - 1), after = Math.min(before + 1, this.data.frames - 1);
      const share = this.frame - before, r = [];
      for (let k = 0; k < 12; k++) r.push((1 - share) * values[12 * before + k] + share * values[12 * after + k]);
      return matrix.set(r[0], r[1], r[2], r[9], r[3], r[4], r[5], r[10], r[6], r[7], r[8], r[11], 0, 0, 0, 1);
    }

    // Where a named point is at the present frame.
    point(name) {
      const values = this.data.arrays[`point_${name}`], last = this.data.frames - 1;
      const before = Math.min(Math.floor(this.frame), last), after = Math.min(before + 1, last), share = this.frame - before;
      return [0, 1, 2].map((axis) => (1 - share) * values[3 * before + axis] + share * values[3 * after + axis]);
    }

    // Places the points of a part around the tongue at the present frame.
    placeContext({ name, rounding_mm }, position) {
      const { arrays, frames } = this.data, rest = arrays[`context_${name}_points`], moved = arrays[`context_${name}_moved`];
      const before = Math.min(Math.floor(this.frame), frames - 1), after = Math.min(before + 1, frames - 1);
      const share = this.frame - before, n = rest.length / 3;
      for (let k = 0; k < rest.length; k++) {
        const place = (k % 3) * n + Math.floor(k / 3);
        position[k] = rest[k] + rounding_mm * ((1 - share) * moved[before * rest.length + place] + share * moved[after * rest.length + place]);
      }
    }

    toolHeight() {
      const values = this.data.arrays.tool_heights, last = this.data.frames - 1;
      const before = Math.min(Math.floor(this.frame), last), after = Math.min(before + 1, last), share = this.frame - before;
      return (1 - share) * values[before] + share * values[after];
    }

    // The midsagittal outline: a path of SVG, x to the right and z up, at rest or as it is now.
    outline(position) {
      const { arrays, loops } = this.data;
      if (!arrays.cut_share) return "";
      const at = (k) => {
        const a = 3 * arrays.cut_ends[2 * k], b = 3 * arrays.cut_ends[2 * k + 1], share = arrays.cut_share[k];
        return [(1 - share) * position[a] + share * position[b], -(1 - share) * position[a + 2] - share * position[b + 2]];
      };
      const words = ([x, y]) => `${x.toFixed(2)} ${y.toFixed(2)}`;
      return loops.map((loop) => {
        const points = loop.map(at), n = points.length;
        if (!this.data.round) return `M${points.map(words).join("L")}Z`;
        // A smooth curve through the points, as smooth_loop of outline.py.
        const between = (a, b) => [b[0] - a[0], b[1] - a[1]];
        const along = points.map((_, k) => {
          const [x, y] = between(points[(k + n - 1) % n], points[(k + 1) % n]), size = Math.hypot(x, y) || 1;
          return [x / size, y / size];
        });
        const curves = points.map((a, k) => {
          const next = (k + 1) % n, b = points[next], handle = Math.hypot(...between(a, b)) / 3;
          const c = [a[0] + handle * along[k][0], a[1] + handle * along[k][1]];
          const d = [b[0] - handle * along[next][0], b[1] - handle * along[next][1]];
          return `C${words(c)} ${words(d)} ${words(b)}`;
        });
        return `M${words(points[0])}${curves.join("")}Z`;
      }).join("");
    }
  }

  class Scene {
    constructor(canvas, body) {
      this.body = body;
      this.canvas = canvas;
      this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !drawnByProcessor(), alpha: true, powerPreference: "low-power" });
      this.renderer.localClippingEnabled = true;
      this.sharpness = 1;
      this.scene = new THREE.Scene();
      this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, -1000, 1000);
      this.camera.up.set(0, 0, 1);
      this.controls = new THREE.OrbitControls(this.camera, canvas);
      this.controls.enableDamping = false;
      // A page that is read on a telephone is moved with one finger, so the picture takes two.
      this.controls.touches = { ONE: null, TWO: THREE.TOUCH.DOLLY_ROTATE };
      canvas.style.touchAction = "pan-y";
      this.controls.enableZoom = false; // the wheel turns the page; see "zoom"
      this.field = "displacement";
      this.addLights();
      this.addBody();
      this.addBones();
      this.addContext();
      this.addPoints();
      this.addFibres();
      this.addLeak();
      this.frameAll();
    }

    addLights() {
      this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8d8378, 1.9));
      this.lamp = new THREE.DirectionalLight(0xffffff, 1.7);
      this.scene.add(this.lamp, this.lamp.target);
    }

    addBody() {
      const { arrays, smooth } = this.body.data;
      const position = new THREE.BufferAttribute(this.body.drawn, 3);
      this.colours = new THREE.BufferAttribute(new Float32Array(this.body.drawn.length), 3);
      this.material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide, flatShading: !smooth });
      this.material.polygonOffset = true;
      this.material.polygonOffsetFactor = this.material.polygonOffsetUnits = 1;
      const part = (...names) => {
        const geometry = new THREE.BufferGeometry();
        const size = names.reduce((sum, name) => sum + arrays[`faces_${name}`].length, 0), faces = new Uint32Array(size);
        let begin = 0;
        for (const name of names) {
          faces.set(arrays[`faces_${name}`], begin);
          begin += arrays[`faces_${name}`].length;
        }
        geometry.setIndex(new THREE.BufferAttribute(faces, 1));
        geometry.setAttribute("position", position);
        geometry.setAttribute("color", this.colours);
        const mesh = new THREE.Mesh(geometry, this.material);
        mesh.frustumCulled = false;
        this.scene.add(mesh);
        return mesh;
      };
      this.parts = { whole: part("left", "right"), half: part("right"), section: part("cut") };
      this.hasSection = arrays.faces_cut.length > 0;
      const lines = new THREE.BufferGeometry();
      lines.setIndex(new THREE.BufferAttribute(arrays.edges, 1));
      lines.setAttribute("position", position);
      this.lines = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ transparent: true, opacity: 0.35 }));
      this.lines.frustumCulled = false;
      const rest = new THREE.BufferGeometry();
      rest.setIndex(new THREE.BufferAttribute(arrays.edges, 1));
      rest.setAttribute("position", new THREE.BufferAttribute(this.body.drawnAtRest, 3));
      this.rest = new THREE.LineSegments(rest, new THREE.LineBasicMaterial({ transparent: true, opacity: 0.3 }));
      this.scene.add(this.lines, this.rest);
    }

    addSurface(points, triangles, colour, opacity, hidesItself = false) {
      const geometry = new THREE.BufferGeometry();
      geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
      geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
      geometry.computeVertexNormals();
      const material = new THREE.MeshLambertMaterial({ color: colour, transparent: true, opacity, depthWrite: hidesItself });
      const mesh = new THREE.Mesh(geometry, material);
      mesh.matrixAutoUpdate = false;
      mesh.renderOrder = 1;
      this.scene.add(mesh);
      return mesh;
    }

    addBones() {
      const { arrays, bones, teeth, tool } = this.body.data;
      this.bones = bones.map((bone) => [
        bone,
        this.addSurface(arrays[`bone_${bone.name}_points`], arrays[`bone_${bone.name}_triangles`], "#e3d3ae", 0.28),
      ]);
      // The edges of the cut through the bones, at rest.
      this.cutLines = bones.map((bone) => {
        const places = bone.outlines.flatMap((loop) => loop.flatMap((point, k) => [loop.at(k - 1), point].flatMap(([x, z]) => [x, this.body.data.plane_mm, z])));
        const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
        const line = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: "#8c7b5a" }));
        line.matrixAutoUpdate = line.frustumCulled = false;
        this.scene.add(line);
        return [bone, line];
      });
      for (const name of teeth) {
        const crowns = this.addSurface(arrays[`teeth_${name}_points`], arrays[`teeth_${name}_triangles`], "#f7f3e4", 0.6, true);
        this.bones.push([bones.find((bone) => bone.name === name), crowns]);
      }
      this.tool = tool && this.addSurface(arrays.tool_points, arrays.tool_triangles, "#8a8f98", 0.45);
    }

    addContext() {
      const { arrays, context } = this.body.data;
      this.context = context.map((part) => [
        part,
        this.addSurface(arrays[`context_${part.name}_points`].slice(), arrays[`context_${part.name}_triangles`], part.colour, 0.42),
      ]);
    }

    addPoints() {
      const size = 0.009 * this.extent();
      const ball = new THREE.SphereGeometry(size, 12, 8);
      this.points = this.body.data.points.map((point) => {
        const mesh = new THREE.Mesh(ball, new THREE.MeshBasicMaterial({ color: "#d55e00", depthTest: false, transparent: true }));
        mesh.renderOrder = 2;
        this.scene.add(mesh);
        return [point, mesh];
      });
    }

    extent() {
      const box = this.box();
      return Math.hypot(box[1] - box[0], box[3] - box[2], box[5] - box[4]);
    }

    // Bounds of the body over all frames, x, y and z.
    box() {
      if (this.bounds) return this.bounds;
      const { arrays, rounding_mm, frames } = this.body.data, n = this.body.nodes, bounds = [];
      for (let axis = 0; axis < 3; axis++) {
        let low = Infinity, high = -Infinity;
        for (let frame = 0; frame < frames; frame++) {
          for (let k = 0; k < n; k++) {
            const x = arrays.points[3 * k + axis] + rounding_mm * arrays.moved[(3 * frame + axis) * n + k];
            low = Math.min(low, x);
            high = Math.max(high, x);
          }
        }
        bounds.push(low, high);
      }
      this.bounds = bounds;
      return bounds;
    }

    // The fibres of the muscles that pull, seen through the body; those of the right half are drawn apart.
    addFibres() {
      const { arrays, muscles } = this.body.data;
      this.fibres = [];
      if (!muscles.length) return;
      this.fibrePlaces = new THREE.BufferAttribute(new Float32Array(arrays.fibres), 3);
      let first = 0;
      for (const muscle of muscles) {
        const halves = { left: [], right: [] };
        for (const count of muscle.lines) {
          const half = halves[arrays.fibres[3 * first + 1] < -1e-3 ? "left" : "right"];
          for (let k = first + 1; k < first + count; k++) half.push(k - 1, k);
          first += count;
        }
        for (const [side, ends] of Object.entries(halves)) {
          const geometry = new THREE.BufferGeometry();
          geometry.setIndex(ends);
          geometry.setAttribute("position", this.fibrePlaces);
          const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ transparent: true, depthTest: false }));
          lines.renderOrder = 2;
          lines.frustumCulled = false;
          this.fibres.push([muscle, side, lines]);
          this.scene.add(lines);
        }
      }
    }

    moveFibres() {
      if (!this.fibres.length) return;
      const { arrays } = this.body.data;
      this.body.place(arrays.fibres_moved, arrays.fibres, this.fibrePlaces.array);
      this.fibrePlaces.needsUpdate = true;
      for (const [muscle, , lines] of this.fibres) {
        const share = this.body.pull(muscle);
        lines.material.color.set("#c9c9c9").lerp(new THREE.Color("#d1003f"), share);
        lines.material.opacity = 0.3 + 0.7 * share;
      }
    }

    // The widest way for air along the roof of the mouth, in front of everything.
    addLeak() {
      const { leak } = this.body.data;
      if (!leak) return;
      this.leakPlaces = new THREE.BufferAttribute(new Float32Array(3 * leak), 3);
      const geometry = new THREE.BufferGeometry();
      geometry.setIndex(Array.from({ length: 2 * (leak - 1) }, (_, k) => (k + 1) >> 1));
      geometry.setAttribute("position", this.leakPlaces);
      this.leak = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ transparent: true, depthTest: false }));
      this.leak.renderOrder = 3;
      this.leak.frustumCulled = false;
      this.scene.add(this.leak);
    }

    moveLeak() {
      if (!this.leak) return;
      const { arrays, leak } = this.body.data, frame = Math.round(this.body.frame);
      this.leakPlaces.array.set(arrays.leak.subarray(3 * leak * frame, 3 * leak * (frame + 1)));
      this.leakPlaces.needsUpdate = true;
      this.leak.material.color.set(arrays.leak_closed[frame] ? "#8a8a8a" : "#0a6cff");
    }

    // The middle is that of body and bones; the size is that of the body, as bones go on beyond what is of interest.
    frameAll() {
      const box = new THREE.Box3(), b = this.box();
      box.min.set(b[0], b[2], b[4]);
      box.max.set(b[1], b[3], b[5]);
      for (const [, mesh] of this.bones) box.expandByObject(mesh);
      box.getCenter(this.controls.target);
      this.radius = 0.55 * this.extent();
      this.camera.zoom = 1;
      this.view("oblique");
    }

    view(name) {
      const [x, y, z] = VIEWS[name], size = Math.hypot(x, y, z), target = this.controls.target;
      this.camera.position.set(target.x + (300 * x) / size, target.y + (300 * y) / size, target.z + (300 * z) / size);
      this.controls.update();
    }

    // Moves the eye around the body by so many steps, to the side and down, as dragging does.
    turn(aside, down) {
      const target = this.controls.target, way = this.camera.position.clone().sub(target), size = way.length(), step = Math.PI / 24;
      const around = Math.atan2(way.y, way.x) - step * aside, from = Math.acos(way.z / size) + step * down;
      const polar = Math.min(Math.PI - 1e-4, Math.max(1e-4, from)), flat = size * Math.sin(polar);
      way.set(flat * Math.cos(around), flat * Math.sin(around), size * Math.cos(polar));
      this.camera.position.copy(target).add(way);
      this.controls.update();
    }

    zoom(factor) {
      this.camera.zoom = Math.min(8, Math.max(0.4, this.camera.zoom * factor));
      this.camera.updateProjectionMatrix();
    }

    show({ cut, bones, context, rest, lines, points, muscles, leak }) {
      const half = cut && this.hasSection;
      this.parts.whole.visible = !half;
      this.parts.half.visible = this.parts.section.visible = half;
      this.lines.visible = lines && !half;
      this.rest.visible = rest;
      const surfaces = this.tool ? [...this.bones, [null, this.tool]] : this.bones;
      for (const [, mesh] of surfaces) mesh.visible = bones;
      for (const [, mesh] of this.context) mesh.visible = context;
      for (const [, line] of this.cutLines) line.visible = half && bones;
      // Bones, teeth and what is around the body are cut at the same plane; their insides are then seen.
      for (const [, { material }] of [...surfaces, ...this.context]) {
        material.clippingPlanes = half ? [{ normal: this.camera.up.clone().set(0, 1, 0), constant: -this.body.data.plane_mm }] : null;
        material.side = half ? THREE.DoubleSide : 0;
        material.needsUpdate = true;
      }
      for (const [, mesh] of this.points) mesh.visible = points;
      if (this.leak) this.leak.visible = leak;
      for (const [, side, mesh] of this.fibres) mesh.visible = muscles && !(half && side === "left");
    }

    colourBy(name) {
      this.field = name;
      this.material.vertexColors = name !== "";
      this.material.color.set(name ? "#ffffff" : "#c8706a");
      this.material.needsUpdate = true;
    }

    theme(ink) {
      this.lines.material.color.set(ink);
      this.rest.material.color.set(ink);
    }

    // Draws the body as it is now.
    draw() {
      const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
      const ratio = this.sharpness * Math.min(2, window.devicePixelRatio || 1);
      if (this.canvas.width !== Math.floor(width * ratio) || this.canvas.height !== Math.floor(height * ratio)) {
        this.renderer.setPixelRatio(ratio);
        this.renderer.setSize(width, height, false);
      }
      const across = Math.max(1, width / height), up = Math.max(1, height / width);
      Object.assign(this.camera, { left: -this.radius * across, right: this.radius * across, top: this.radius * up, bottom: -this.radius * up });
      this.camera.updateProjectionMatrix();
      if (this.field) {
        this.body.paint(this.colours.array, this.field);
        this.colours.needsUpdate = true;
      }
      for (const mesh of Object.values(this.parts)) {
        if (!mesh.visible) continue;
        mesh.geometry.attributes.position.needsUpdate = true;
        if (this.body.data.smooth) mesh.geometry.computeVertexNormals();
      }
      for (const [bone, mesh] of [...this.bones, ...this.cutLines]) {
        mesh.matrix.copy(this.body.placement(bone));
        mesh.matrixWorldNeedsUpdate = true;
      }
      for (const [part, mesh] of this.context) {
        if (!part.moves || !mesh.visible) continue;
        this.body.placeContext(part, mesh.geometry.attributes.position.array);
        mesh.geometry.attributes.position.needsUpdate = true;
        mesh.geometry.computeVertexNormals();
      }
      for (const [point, mesh] of this.points) mesh.position.fromArray(this.body.point(point.name));
      if (this.tool) {
        this.tool.matrix.makeTranslation(0, 0, this.body.toolHeight());
        this.tool.matrixWorldNeedsUpdate = true;
      }
      this.moveFibres();
      this.moveLeak();
      this.lamp.position.copy(this.camera.position);
      this.lamp.target.position.copy(this.controls.target);
      this.renderer.render(this.scene, this.camera);
    }
  }

  // Whether the processor draws instead of a graphics card: smooth edges then take longer than all else.
  function drawnByProcessor() {
    const gl = document.createElement("canvas").getContext("webgl2");
    const names = gl.getExtension("WEBGL_debug_renderer_info");
    return /swiftshader|llvmpipe|software|basic render/i.test(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  }

  const scale = `linear-gradient(to right, ${SCALE.join(", ")})`;
  return { unpack, Body, Scene, scale };
})();
