// Plays the results of a page together: one slider moves every body, outline and mark of a chart.
"use strict";

(async () => {
  const page = document.querySelector("main");
  const bar = document.querySelector(".player");
  if (!bar) return;
  const control = (name) => bar.querySelector(`[data-control="${name}"]`);
  const slider = control("time"), playButton = control("play"), clock = bar.querySelector(".clock");
  const hasWebGL = document.createElement("canvas").getContext("webgl2") !== null;
  const began = performance.now();
  const runs = await Promise.all([...document.querySelectorAll("[data-run]")].map(prepare));
  // Runs in time share a clock; tests with a tool, whose moments are loads, share the number of the load.
  const first = Math.min(...runs.map((run) => run.abscissa[0])), last = Math.max(...runs.map((run) => run.abscissa.at(-1)));
  const inTime = runs.every((run) => !run.body.data.moments);
  const state = { now: first, playing: false, before: 0, numbersAt: 0, numbersLater: 0, slow: 0 };
  const MS_BETWEEN_NUMBERS = 100, LONGEST_FRAME_S = 0.04;
  const stillReader = matchMedia("(prefers-reduced-motion: reduce)").matches;
  slider.min = first;
  slider.max = last;
  slider.step = (last - first) / 1000 || 1;

  async function prepare(section) {
    const data = await Playback.unpack(section.querySelector("script[type='application/octet-stream']").textContent);
    const body = new Playback.Body(data);
    const run = { section, body, abscissa: data.arrays.times };
    const canvas = section.querySelector("canvas");
    // Without WebGL the outline and the charts still move.
    canvas.hidden = !hasWebGL;
    section.querySelector(".no-3d").hidden = hasWebGL;
    if (hasWebGL) run.scene = new Playback.Scene(canvas, body);
    drawContour(run);
    run.moment = prepareMoment(run);
    return run;
  }

  // ---- the outline in the midsagittal plane ----

  function drawContour(run) {
    const { body, section } = run, data = body.data, svg = section.querySelector(".contour svg");
    const bounds = data.outline_box;
    if (!bounds) return;
    svg.setAttribute("viewBox", `${bounds[0]} ${-bounds[3]} ${bounds[1] - bounds[0]} ${bounds[3] - bounds[2]}`);
    const make = (tag, group, of = {}) => {
      const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
      for (const [key, value] of Object.entries(of)) node.setAttribute(key, value);
      svg.querySelector(`.${group}`).append(node);
      return node;
    };
    const path = (loop, close) => `M${loop.map(([x, z]) => `${x} ${-z}`).join("L")}${close ? "Z" : ""}`;
    run.boneLines = data.bones.map((bone) => [
      bone,
      bone.outlines.map((loop) => make("path", "bones", { d: path(loop, true) })),
    ]);
    if (data.tool) run.toolLine = make("path", "bones", { d: path(data.tool.outline, false) });
    make("path", "rest", { d: body.outline(data.arrays.points) });
    run.outline = make("path", "body");
    run.marks = data.points.filter((point) => point.in_plane).map((point) => {
      const places = data.arrays[`point_${point.name}`], line = [];
      for (let k = 0; k < data.frames; k++) line.push([places[3 * k].toFixed(2), places[3 * k + 2].toFixed(2)]);
      make("path", "paths", { d: path(line, false) });
      const [dot, text] = [make("circle", "points"), make("text", "points")];
      text.textContent = point.name;
      return [point, dot, text];
    });
  }

  function moveContour(run) {
    if (!run.outline) return;
    const { body } = run, svg = run.outline.ownerSVGElement;
    run.outline.setAttribute("d", body.outline(body.position));
    const mmPerPixel = svg.viewBox.baseVal.width / (svg.clientWidth || 1);
    for (const [bone, lines] of run.boneLines) {
      if (!bone.moves) continue;
      const e = body.placement(bone).elements; // column after column; x stays x, z goes up, which is down in SVG
      for (const line of lines) line.setAttribute("transform", `matrix(${e[0]} ${-e[2]} ${-e[8]} ${e[10]} ${e[12]} ${-e[14]})`);
    }
    if (run.toolLine) run.toolLine.setAttribute("transform", `translate(0 ${-body.toolHeight()})`);
    for (const [point, dot, text] of run.marks) {
      const [x, , z] = body.point(point.name);
      dot.setAttribute("cx", x);
      dot.setAttribute("cy", -z);
      dot.setAttribute("r", 3.5 * mmPerPixel);
      text.setAttribute("x", x + 6 * mmPerPixel);
      text.setAttribute("y", -z - 5 * mmPerPixel);
      text.setAttribute("font-size", 12 * mmPerPixel);
    }
  }

  // ---- contact with the palate, areas of the airway and formants ----

  function prepareMoment({ section, body }) {
    const figure = section.querySelector(".moment");
    if (!figure) return;
    const svg = figure.querySelector("svg"), { electrodes } = body.data, dot = document.createElement("b");
    dot.className = "dot";
    section.querySelector(".vowels .field").append(dot);
    figure.querySelector(".palatogram").hidden = !electrodes;
    const squares = (electrodes ?? []).map((number) => {
      const square = document.createElementNS("http://www.w3.org/2000/svg", "rect");
      for (const [key, value] of Object.entries({ x: (number % 8) + 0.06, y: Math.floor(number / 8) + 0.06, width: 0.88, height: 0.88 })) square.setAttribute(key, value);
      svg.append(square);
      return square;
    });
    return { figure, dot, squares, ...JSON.parse(figure.dataset.moments), shown: -1, areas: [...section.querySelectorAll(".areas svg > g:not(.grid)")] };
  }

  function moveMoment({ section, body, moment }) {
    if (!moment) return;
    const { squares, times, formants, dot, figure, areas } = moment, { arrays, frames } = body.data;
    const say = (name, text) => section.querySelectorAll(`output[data-of="${name}"]`).forEach((output) => (output.textContent = text));
    const frame = Math.min(Math.round(body.frame), frames - 1), at = arrays.times[frame];
    if (frame === moment.frame) return;
    moment.frame = frame;
    squares.forEach((square, k) => square.classList.toggle("on", arrays.contacts[frame * squares.length + k] > 0));
    say("contacts", figure.querySelectorAll(".on").length);
    const nearest = times.reduce((best, time, k) => (Math.abs(time - at) < Math.abs(times[best] - at) ? k : best), 0);
    if (nearest === moment.shown) return;
    moment.shown = nearest;
    areas.forEach((group, k) => group.classList.toggle("shown", k >> 1 === nearest));
    const heard = formants[nearest], range = (name) => dot.closest(".chart").dataset[name].split(" ").map(Number);
    ["F1", "F2", "F3"].forEach((name, k) => say(name, heard ? heard[k].toFixed(0) : ""));
    say("time", `${times[nearest].toFixed(0)} ms`);
    figure.querySelector("dl").hidden = dot.hidden = !heard;
    figure.querySelector(".closed").hidden = Boolean(heard);
    if (!heard) return;
    const [[left, right], [bottom, top]] = [range("x"), range("y")];
    dot.style.left = `${(100 * (heard[1] - left)) / (right - left)}%`;
    dot.style.bottom = `${(100 * (heard[0] - bottom)) / (top - bottom)}%`;
  }

  // ---- the marks in charts ----

  const charts = [...document.querySelectorAll("figure[data-follows]")].map((figure) => {
    const numbers = (name) => figure.dataset[name].split(" ").map(Number);
    const lines = [...figure.querySelectorAll("[data-series]")].map((group) => {
      const pieces = [...group.children].map((line) => line.getAttribute("points").split(" ").map((point) => point.split(",").map(Number)));
      if (!group.matches(".band, .dark-band")) return { line: pieces };
      // The points of a band go along its lower edge, and back along the upper one.
      return { line: pieces.map((piece) => piece.slice(0, piece.length / 2)), top: pieces.map((piece) => piece.slice(piece.length / 2).reverse()) };
    });
    const run = runs.find((one) => one.section.contains(figure));
    const mark = figure.querySelector(".now");
    mark.hidden = false;
    return { figure, run, mark, lines, x: numbers("x"), y: numbers("y"), outputs: [...figure.querySelectorAll(".legend output")] };
  });

  // The value of a line at a place across, from its points; NaN where it has none.
  function valueOf(pieces, across) {
    for (const piece of pieces) {
      if (piece.length < 2 || across < piece[0][0] || across > piece.at(-1)[0]) continue;
      const k = Math.max(1, piece.findIndex(([x]) => x >= across));
      const [[a, low], [b, high]] = [piece[k - 1], piece[k]];
      return b > a ? low + ((high - low) * (across - a)) / (b - a) : high;
    }
    return NaN;
  }

  // Numbers that change with every frame cannot be read, and cost more than all that moves.
  function moveMarks(withNumbers) {
    for (const { figure, run, mark, lines, x, y, outputs } of charts) {
      if (!seen.has(figure)) continue;
      const at = figure.dataset.follows === "time" ? state.now : interpolate(run.body.data.indentation, run.body.frame);
      const across = (1000 * (at - x[0])) / (x[1] - x[0]);
      mark.hidden = across < -1 || across > 1001;
      mark.style.transform = `translateX(${across / 10}%)`;
      if (!withNumbers) continue;
      outputs.forEach((output, k) => {
        const { line, top } = lines[k], inside = Math.min(1000, Math.max(0, across)), place = valueOf(line, inside);
        const share = top ? (place - valueOf(top, inside)) / 1000 : 1 - place / 1000; // of a band its height
        const value = (top ? 0 : y[0]) + share * (y[1] - y[0]);
        output.textContent = Number.isFinite(value) ? shown("logarithmic" in figure.dataset ? 10 ** value : value, y[1] - y[0]) : "";
      });
    }
  }

  function interpolate(values, frame) {
    const k = Math.min(Math.floor(frame), values.length - 1), next = Math.min(k + 1, values.length - 1);
    return values[k] + (frame - k) * (values[next] - values[k]);
  }

  // A number with as many digits as the height of its chart tells apart.
  function shown(value, span) {
    const digits = Math.min(6, Math.max(0, 2 - Math.floor(Math.log10(span || 1))));
    return (Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toFixed(digits).replace("-", "\u2212");
  }

  // Only what is on the screen is drawn.
  const seen = new Set();
  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) seen[isIntersecting ? "add" : "delete"](target);
    show(state.now);
    page.dataset.ready ??= Math.round(performance.now() - began);
  }, { rootMargin: "40px" });

  // ---- time ----

  function frameAt(run, now) {
    const at = run.abscissa;
    if (now >= at.at(-1)) return at.length - 1;
    let low = 0, high = at.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (at[middle] <= now) low = middle;
      else high = middle;
    }
    return Math.max(0, low + (now - at[low]) / (at[high] - at[low] || 1));
  }

  function words() {
    if (inTime) return `${state.now.toFixed(last - first > 50 ? 0 : 1)} ms`;
    const { moments } = runs[0].body.data;
    return moments ? moments[Math.round(frameAt(runs[0], state.now))] : "";
  }

  function showTime() {
    slider.value = state.now;
    slider.setAttribute("aria-valuetext", words());
    clock.textContent = words();
  }

  function show(now) {
    state.now = Math.min(last, Math.max(first, now));
    const withNumbers = performance.now() - state.numbersAt > MS_BETWEEN_NUMBERS;
    if (withNumbers || !state.playing) showTime();
    for (const run of runs) {
      run.body.at(frameAt(run, state.now));
      if (seen.has(run.section.querySelector("canvas"))) run.scene?.draw();
      if (seen.has(run.outline?.ownerSVGElement)) moveContour(run);
    }
    runs.forEach(moveMoment);
    moveMarks(withNumbers);
    if (withNumbers) state.numbersAt = performance.now();
    clearTimeout(state.numbersLater);
    state.numbersLater = setTimeout(moveMarks, MS_BETWEEN_NUMBERS, true);
  }

  function play(on) {
    state.playing = on;
    if (on && state.now >= last) state.now = first;
    playButton.textContent = on ? "Pause" : "Play";
    playButton.setAttribute("aria-pressed", on);
    state.before = performance.now();
    for (const run of runs) if (run.scene && !on) run.scene.sharpness = 1;
    if (on) requestAnimationFrame(advance);
    else show(state.now);
  }

  // Two seconds show the whole at first: speech itself is too fast to be seen.
  const SECONDS_FOR_ALL = 2.5, REST_SECONDS = 0.8;
  let waited = 0, drawn = 0;

  // While it moves, a slow machine draws fewer dots rather than fewer pictures.
  function keepPace(passed) {
    state.slow = 0.8 * state.slow + 0.2 * passed;
    if (state.slow < LONGEST_FRAME_S) return;
    state.slow = 0;
    for (const run of runs) if (run.scene) run.scene.sharpness = Math.max(0.4, 0.75 * run.scene.sharpness);
  }

  function advance(moment) {
    if (!state.playing) return;
    const passed = Math.max(0, moment - state.before) / 1000;
    state.before = moment;
    if (state.now >= last) {
      waited += passed;
      if (waited > REST_SECONDS) {
        waited = 0;
        show(first);
      }
    } else {
      show(state.now + (passed * Number(control("speed").value) * (last - first)) / SECONDS_FOR_ALL);
    }
    keepPace(passed);
    drawn += 1;
    page.dataset.drawn = drawn;
    requestAnimationFrame(advance);
  }

  // ---- what a reader can do ----

  const scenes = runs.map((run) => run.scene).filter(Boolean);
  const redraw = () => show(state.now);

  slider.addEventListener("input", () => {
    const wanted = Number(slider.value); // stopping puts the slider back to where it was
    play(false);
    show(wanted);
  });
  playButton.addEventListener("click", () => play(!state.playing));
  bar.querySelectorAll("[data-view]").forEach((button) =>
    button.addEventListener("click", () => {
      scenes.forEach((scene) => scene.view(button.dataset.view));
      redraw();
    }));
  bar.querySelectorAll("[data-zoom]").forEach((button) =>
    button.addEventListener("click", () => {
      scenes.forEach((scene) => scene.zoom(Number(button.dataset.zoom)));
      redraw();
    }));
  const switches = [...bar.querySelectorAll("[data-show]")];
  const applySwitches = () => {
    const wanted = Object.fromEntries(switches.map((box) => [box.dataset.show, box.checked]));
    scenes.forEach((scene) => scene.show(wanted));
  };
  switches.forEach((box) =>
    box.addEventListener("change", () => {
      applySwitches();
      redraw();
    }));

  const fields = new Map([["", null], ["displacement", { label: "displacement", unit: "mm" }]]);
  for (const run of runs) for (const field of run.body.data.fields) if (!fields.has(field.name)) fields.set(field.name, field);
  for (const name of fields.keys()) {
    const spans = runs.map((run) => run.body.spans[name]).filter(Boolean);
    const common = [Math.min(...spans.map(([low]) => low)), Math.max(...spans.map(([, high]) => high))];
    for (const run of runs) if (run.body.spans[name]) run.body.spans[name] = common;
  }
  const choice = control("colour");
  for (const [name, field] of fields) {
    const option = document.createElement("option");
    option.value = name;
    option.textContent = field ? `${field.label}${field.unit ? ` (${field.unit})` : ""}` : "plain tissue";
    choice.append(option);
  }
  choice.value = "displacement";
  const applyColour = () => {
    for (const run of runs) {
      const name = choice.value, field = run.body.data.fields.find((one) => one.name === name), scale = run.section.querySelector(".scale");
      const known = name === "" || name === "displacement" || field;
      run.scene?.colourBy(known ? name : "");
      scale.hidden = !known || name === "";
      if (scale.hidden) continue;
      const [low, high] = run.body.spans[name], unit = field ? field.unit : "mm";
      scale.querySelector("i").style.background = Playback.scale;
      scale.querySelector(".low").textContent = Number(low.toPrecision(3));
      scale.querySelector(".high").textContent = `${Number(high.toPrecision(3))} ${unit}`;
    }
  };
  choice.addEventListener("change", () => {
    applyColour();
    redraw();
  });

  // All bodies are seen from the same side.
  const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }, zooms = { "+": 1.25, "=": 1.25, "-": 0.8 };
  for (const scene of scenes) {
    scene.canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in turns || event.key in zooms)) return;
      event.preventDefault();
      event.stopPropagation(); // these keys move in time elsewhere on the page
      if (event.key in turns) scene.turn(...turns[event.key]);
      else scenes.forEach((one) => one.zoom(zooms[event.key]));
      redraw();
    });
    scene.controls.addEventListener("change", () => {
      for (const other of scenes) {
        if (other === scene) continue;
        const way = scene.camera.position.clone().sub(scene.controls.target);
        other.camera.position.copy(other.controls.target).add(way);
        other.camera.lookAt(other.controls.target);
      }
      for (const one of scenes) one.draw();
    });
  }

  for (const { figure } of charts) {
    const field = figure.querySelector(".field");
    const seek = (event) => {
      if (figure.dataset.follows !== "time" || !(event.buttons & 1)) return;
      const box = field.getBoundingClientRect(), [left, right] = figure.dataset.x.split(" ").map(Number);
      play(false);
      show(left + ((right - left) * (event.clientX - box.left)) / box.width);
    };
    field.addEventListener("pointerdown", seek);
    field.addEventListener("pointermove", seek);
  }

  // Keys of the whole page, unless one writes or chooses somewhere.
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select, summary, a, button, input:not([type=range])")) return;
    const step = (last - first) / 100;
    const actions = {
      " ": () => play(!state.playing),
      ArrowLeft: () => show(state.now - step),
      ArrowRight: () => show(state.now + step),
      Home: () => show(first),
      End: () => show(last),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    if (event.key !== " ") play(false);
    action();
  });

  const ink = () => {
    const colour = getComputedStyle(page).getPropertyValue("color");
    scenes.forEach((scene) => scene.theme(colour));
    redraw();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ink);
  document.querySelectorAll(".theme input").forEach((input) => input.addEventListener("change", ink));
  new ResizeObserver(redraw).observe(page);

  // On a telephone, or a low screen, the picture needs the room that these would take.
  bar.querySelector(".options").open = innerWidth > 600 && innerHeight > 700;
  applySwitches();
  applyColour();
  bar.hidden = false;
  ink();
  if (!stillReader && last > first) play(true);
  else show(last);
  // Drawn when the browser says what is on the screen.
  document.querySelectorAll("canvas, .contour svg, figure[data-follows]").forEach((picture) => watcher.observe(picture));
})();
