// Draws a scatter plot of any two columns of a sweep, and names the run of a point.
"use strict";

(async () => {
  const section = document.querySelector("[data-scatter]");
  if (!section) return;
  const NONE = 65535, SIDE = 1000, MARGIN = 0.05, TICKS = 6, NEAR_PIXELS = 24, COLOURS = 7;
  const SVG = "http://www.w3.org/2000/svg";
  const KINDS = { "<u4": Uint32Array, "<u2": Uint16Array, "<u1": Uint8Array };
  const data = await unpack(section.querySelector("script[type='application/octet-stream']").textContent);
  const figure = section.querySelector("figure.chart"), field = figure.querySelector(".field"), svg = field.querySelector("svg");
  const [across, up] = ["x", "y"].map((name) => section.querySelector(`[data-axis="${name}"]`));
  const said = section.querySelector("[data-said]");
  let shown = [];

  async function unpack(base64) {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const block = await new Response(stream).arrayBuffer();
    const size = new DataView(block).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(block, 4, size)));
    const arrays = {};
    for (const [name, [kind, place, count]] of Object.entries(header.arrays)) arrays[name] = new KINDS[kind](block, 4 + size + place, count);
    return { ...header, arrays };
  }

  const value = (column, row) => {
    const { low, size } = data.columns[column], step = data.arrays[`column_${column}`][row];
    return step === NONE ? NaN : low + (size * step) / data.steps;
  };

  // The ends of an axis, and its marks: round numbers, or the words of a factor.
  function axisOf(column, values) {
    const { levels } = data.columns[column];
    if (levels.length) return { low: -0.5, high: levels.length - 0.5, ticks: levels.map((word, k) => [k, word]) };
    let low = Math.min(...values), high = Math.max(...values);
    if (!(high - low > 1e-12 * Math.max(Math.abs(low), Math.abs(high)))) {
      const half = 0.05 * Math.abs(low) || 0.5;
      [low, high] = [low - half, high + half];
    }
    const margin = MARGIN * (high - low);
    [low, high] = [low - margin, high + margin];
    const rough = (high - low) / TICKS, ten = 10 ** Math.floor(Math.log10(rough));
    const step = ten * [1, 2, 5, 10].find((factor) => factor * ten >= rough * (1 - 1e-9));
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), ticks = [];
    const plain = digits <= 4 && Math.max(Math.abs(low), Math.abs(high)) < 1e5;
    for (let k = Math.ceil(low / step); k <= Math.floor(high / step); k++) {
      const number = k * step;
      ticks.push([number, k === 0 ? "0" : (plain ? number.toFixed(digits) : number.toExponential(1)).replace(/-/g, "\u2212")]);
    }
    return { low, high, ticks };
  }

  const make = (tag, attributes) => {
    const node = document.createElementNS(SVG, tag);
    for (const [key, text] of Object.entries(attributes)) node.setAttribute(key, text);
    return node;
  };

  function draw() {
    const [a, b] = [Number(across.value), Number(up.value)], rows = [];
    for (let row = 0; row < data.arrays.member.length; row++) {
      const [x, y] = [value(a, row), value(b, row)];
      if (Number.isFinite(x) && Number.isFinite(y)) rows.push([row, x, y]);
    }
    const lacking = data.arrays.member.length - rows.length;
    section.querySelector("[data-lacking]").textContent = lacking ? `${lacking} runs lack one of the two values.` : "";
    figure.querySelector(".x-label").textContent = data.columns[a].title;
    figure.querySelector(".y-label").textContent = data.columns[b].title;
    svg.setAttribute("aria-label", `${data.columns[b].title} against ${data.columns[a].title}`);
    const [xAxis, yAxis] = [axisOf(a, rows.length ? rows.map((r) => r[1]) : [0]), axisOf(b, rows.length ? rows.map((r) => r[2]) : [0])];
    const share = (axis, number) => (number - axis.low) / (axis.high - axis.low);
    const marks = (selector, axis, side) =>
      figure.querySelector(selector).replaceChildren(...axis.ticks.map(([number, text]) => {
        const mark = document.createElement("i");
        mark.style[side] = `${100 * share(axis, number)}%`;
        mark.textContent = text;
        return mark;
      }));
    marks(".x-ticks", xAxis, "left");
    marks(".y-ticks", yAxis, "bottom");
    const grid = make("g", { class: "grid" });
    for (const [number] of yAxis.ticks) {
      const y = SIDE * (1 - share(yAxis, number));
      grid.append(make("line", { x1: 0, x2: SIDE, y1: y, y2: y }));
    }
    for (const [number] of xAxis.ticks) {
      const x = SIDE * share(xAxis, number);
      grid.append(make("line", { y1: 0, y2: SIDE, x1: x, x2: x }));
    }
    shown = rows.map(([row, x, y]) => [row, share(xAxis, x), 1 - share(yAxis, y)]);
    const groups = data.statuses.map((status, k) => {
      const dots = shown.filter(([row]) => data.arrays.status[row] === k);
      const group = make("g", { class: `s${k % COLOURS} d0 dots`, "data-count": dots.length });
      group.append(make("path", { d: dots.map(([, x, y]) => `M${(SIDE * x).toFixed(1)} ${(SIDE * y).toFixed(1)}h0`).join("") }));
      return group;
    });
    const mark = make("g", { class: "picked" });
    svg.replaceChildren(grid, ...groups, mark);
    const legend = data.statuses.flatMap((status, k) => {
      const count = Number(groups[k].dataset.count);
      if (!count) return [];
      const entry = document.createElement("li"), sample = make("svg", { viewBox: "0 0 24 8", "aria-hidden": "true" });
      entry.className = `s${k % COLOURS} d0 dots`;
      sample.append(make("polyline", { points: "12,4 12,4" }));
      entry.append(sample, `${status} (${count})`);
      return [entry];
    });
    figure.querySelector(".legend").replaceChildren(...legend);
    said.textContent = "";
  }

  // The run of the point nearest to a position on the screen.
  function pick(event) {
    const box = svg.getBoundingClientRect();
    const far = ([, x, y]) => Math.hypot(box.left + x * box.width - event.clientX, box.top + y * box.height - event.clientY);
    let nearest = null, least = NEAR_PIXELS;
    for (const dot of shown) {
      const away = far(dot);
      if (away < least) [nearest, least] = [dot, away];
    }
    const mark = svg.querySelector(".picked");
    mark.replaceChildren();
    said.textContent = "";
    if (!nearest) return;
    const [row, x, y] = nearest;
    mark.append(make("path", { d: `M${SIDE * x} ${SIDE * y}h0` }));
    const worded = [Number(across.value), Number(up.value)].map((column) => {
      const { title, levels } = data.columns[column], number = value(column, row);
      return `${title} ${levels.length ? levels[Math.round(number)] : Number(number.toPrecision(4))}`;
    });
    said.textContent = `run ${data.arrays.member[row]}, ${data.statuses[data.arrays.status[row]]}: ${worded.join("; ")}`;
  }

  for (const choice of [across, up]) choice.addEventListener("change", draw);
  field.addEventListener("pointermove", pick);
  field.addEventListener("pointerdown", pick);
  section.querySelector("[data-choices]").hidden = false;
  draw();
  document.querySelector("main").dataset.ready = "";
})();
