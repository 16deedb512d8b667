// Draws the charts of a report with uPlot: one cursor and one zoom over all that share the run time, and the map.
"use strict";
(() => {
  const held = JSON.parse(document.getElementById("data").textContent);
  const columns = held.columns.map(unpacked);
  const several = held.runs.length > 1;
  const TIME = "run time [s]", NOWHERE = -10, LEFT = 96, NARROW = 640, PAPER = 690;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const readout = document.getElementById("readout");
  const plots = []; // {u, timed, table}: every chart that is drawn
  let aligned = 0, full = null, busy = false, inks = {};

  /** Digits behind the point, then differences; null: unknown. */
  function unpacked(column) {
    const scale = 10 ** column[0], values = new Array(column.length - 1);
    let sum = 0;
    for (let i = 1; i < column.length; i++) {
      if (column[i] !== null) sum += column[i];
      values[i - 1] = column[i] === null ? null : sum / scale;
    }
    return values;
  }

  /** A colour of the style sheet. */
  function ink(name) {
    return inks[name] ??= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  }

  /** Run time of a run [s] that is at zero; of one run its own zero. */
  function shift(run) {
    return several ? held.begins[aligned][1][run] : 0;
  }

  function wholeTime() {
    const begin = Math.min(...held.runs.map((run, at) => run.begin - shift(at)));
    const end = Math.max(...held.runs.map((run, at) => run.end - shift(at)));
    return [begin, Math.max(end, begin + 0.1)];
  }

  /** Last index of sorted values that is not above one; -1: none. */
  function indexBelow(values, value) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] <= value) low = middle + 1; else high = middle;
    }
    return low - 1;
  }

  // ------------------------------------------------------------------------------------------------------ charts

  function tableOf(chart) {
    const tables = chart.parts.map((part) => {
      const by = chart.over === TIME ? shift(part.run) : 0;
      return [columns[part.x].map((x) => x - by), ...part.lines.map((line) => columns[line.y])];
    });
    return tables.length > 1 ? uPlot.join(tables) : tables[0];
  }

  function seriesOf(chart, part, line) {
    const reference = line.ink === "reference";
    const name = several ? `r${part.run}${reference ? "-pale" : ""}` : line.ink;
    const single = columns[part.x].length < 2;
    return {
      label: several ? `${line.name} ${held.runs[part.run].name}` : line.name,
      stroke: () => ink(name),
      width: reference ? 4 : 1.5,
      dash: several && (line.ink === "true" || line.ink === "second") ? [2, 4] : [],
      points: { show: single, size: 4 },
      value: (_, value) => (value == null ? "" : value.toFixed(chart.digits)),
    };
  }

  /** Where runs share an axis, each has its own rows: the nearest row that a line has. */
  function nearestRow(u, number, at) {
    const values = u.data[number];
    for (let off = 0; off < 200; off++) {
      if (values[at - off] !== undefined) return at - off;
      if (values[at + off] !== undefined) return at + off;
    }
    return at;
  }

  function axes(extra) {
    const line = { stroke: () => ink("grid"), width: 1 };
    const axis = { stroke: () => ink("ink"), font: "12px system-ui, sans-serif", grid: line, ticks: { ...line, size: 4 } };
    return [{ ...axis, size: 30, space: 60 }, { ...axis, size: (u) => (u.width > NARROW ? LEFT : 48), space: 28, ...extra }];
  }

  function withFaults(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = uPlot.pxRatio;
    ctx.strokeStyle = ink("alarm");
    ctx.setLineDash([4 * uPlot.pxRatio, 3 * uPlot.pxRatio]);
    held.runs.forEach((run, at) => {
      for (const time of columns[run.events[0].times]) {
        const x = Math.round(u.valToPos(time - shift(at), "x", true));
        ctx.beginPath();
        ctx.moveTo(x, bbox.top);
        ctx.lineTo(x, bbox.top + bbox.height);
        ctx.stroke();
      }
    });
    ctx.restore();
  }

  function zeroLine(u) {
    const y = Math.round(u.valToPos(0, "y", true)), { ctx, bbox } = u;
    if (y < bbox.top || y > bbox.top + bbox.height) return;
    ctx.save();
    ctx.strokeStyle = ink("ink");
    ctx.globalAlpha = 0.5;
    ctx.lineWidth = uPlot.pxRatio;
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    ctx.restore();
  }

  /** Around the values with some room; from zero, or however small they are, not only their noise. */
  function range(chart) {
    const least = 10 * 10 ** -chart.digits;
    return (_, low, high) => {
      if (low === null) return [0, 1];
      const [bottom, top] = chart.zero ? [0, Math.max(high, least)] : [low, Math.max(high, low + least)];
      const room = 0.08 * (top - bottom);
      return [chart.zero ? 0 : bottom - room, top + room];
    };
  }

  function added(place, timed, options, data, table, drawn) {
    const onScale = (u, key) => key === "x" && timed && zoomed(u);
    const u = new uPlot({
      width: place.clientWidth,
      ...options,
      scales: { x: { time: false }, ...options.scales },
      cursor: {
        y: false, drag: { x: true, y: false, dist: 4 }, points: { size: 7 },
        dataIdx: nearestRow, bind: { dblclick: () => () => reset() },
      },
      hooks: { ...options.hooks, setScale: [onScale], setCursor: [(u) => timed && pointed(u)] },
    }, data, place);
    const plot = { u, timed, table, place, drawn };
    plots.push(plot);
    touchable(plot);
    return plot;
  }

  function drawChart(place) {
    const chart = held.charts[Number(place.dataset.chart)], timed = chart.over === TIME;
    const lines = chart.parts.flatMap((part) => part.lines.map((line) => seriesOf(chart, part, line)));
    const marks = [...(chart.zero ? [] : [zeroLine]), ...(timed ? [withFaults] : [])];
    added(place, timed, {
      height: 170,
      series: [{ label: timed ? "t" : "s", value: (_, x) => (x == null ? "" : x.toFixed(2)) }, ...lines],
      axes: axes({}),
      scales: { y: { range: range(chart) } },
      legend: { markers: { dash: (u, at) => (u.series[at].dash?.length ? "dotted" : "solid") }, mount: (_, legend) => place.previousElementSibling.append(legend) },
      hooks: { drawAxes: marks },
    }, tableOf(chart), () => tableOf(chart));
  }

  // ------------------------------------------------------------------------------------- modes, drives and events

  const SHAPES = {
    fault: (p, x, y, r) => { p.moveTo(x - r, y - r); p.lineTo(x + r, y + r); p.moveTo(x + r, y - r); p.lineTo(x - r, y + r); },
    request: (p, x, y, r) => { p.moveTo(x - r, y - r); p.lineTo(x + r, y - r); p.lineTo(x, y + r); p.closePath(); },
    job: (p, x, y, r) => { p.moveTo(x, y - r); p.lineTo(x + r, y); p.lineTo(x, y + r); p.lineTo(x - r, y); p.closePath(); },
  };
  const lanes = held.runs.flatMap((run, at) => [
    ...run.lanes.map((lane) => ({ ...lane, run: at, begins: columns[lane.begins], word: columns[lane.word] })),
    ...run.events.map((events) => ({ ...events, run: at, times: columns[events.times] })),
  ]).filter((lane) => !lane.kind || lane.times.length);
  const laneName = (lane) => (several ? `${lane.name} ${held.runs[lane.run].name}` : lane.name);

  function drawLanes(u) {
    const { ctx, bbox } = u, px = uPlot.pxRatio, height = bbox.height / lanes.length;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.font = `${11.5 * px}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    lanes.forEach((lane, row) => {
      const y = bbox.top + (row + 0.5) * height;
      if (lane.kind) drawEvents(u, lane, y, 4.5 * px); else drawBands(u, lane, y, 0.76 * height);
    });
    ctx.restore();
  }

  function drawBands(u, lane, y, height) {
    const { ctx } = u, right = u.bbox.left + u.bbox.width;
    const at = (time) => Math.min(Math.max(u.valToPos(time - shift(lane.run), "x", true), u.bbox.left), right);
    lane.begins.forEach((begin, number) => {
      const from = at(begin), to = at(lane.begins[number + 1] ?? held.runs[lane.run].end);
      if (to <= u.bbox.left || from >= right) return;
      const word = lane.words[lane.word[number]], width = Math.max(to - from, uPlot.pxRatio);
      ctx.fillStyle = ink(lane.inks[lane.word[number]]);
      ctx.fillRect(from, y - height / 2, width, height);
      if (ctx.measureText(word).width + 8 * uPlot.pxRatio < width) {
        ctx.fillStyle = "#14171a";
        ctx.fillText(word, from + width / 2, y + uPlot.pxRatio / 2);
      }
    });
  }

  function drawEvents(u, lane, y, size) {
    const { ctx } = u;
    for (const time of lane.times) {
      ctx.beginPath();
      SHAPES[lane.kind](ctx, u.valToPos(time - shift(lane.run), "x", true), y, size);
      ctx.lineWidth = 2 * uPlot.pxRatio;
      ctx.strokeStyle = ctx.fillStyle = ink("event-" + lane.kind);
      if (lane.kind === "fault") ctx.stroke(); else ctx.fill();
    }
  }

  function drawTimeline(place) {
    const rows = lanes.length, table = () => [full, [null, null]];
    const names = {
      splits: () => lanes.map((_, row) => rows - row - 0.5), values: () => lanes.map(laneName),
      size: LEFT, grid: { show: false }, ticks: { show: false }, gap: 6,
    };
    added(place, true, {
      height: 22 * rows + 40,
      series: [{}, { points: { show: false } }],
      axes: axes(names),
      scales: { y: { range: [0, rows] } },
      legend: { show: false },
      hooks: { draw: [drawLanes] },
    }, table(), table);
  }

  /** What the lanes are at some time, in words. */
  function told(time, width) {
    const states = lanes.map((lane) => {
      const at = time + shift(lane.run);
      if (!lane.kind) {
        const number = at > held.runs[lane.run].end ? -1 : indexBelow(lane.begins, at);
        return number < 0 ? "" : lane.words[lane.word[number]];
      }
      const after = indexBelow(lane.times, at) + 1, near = [after - 1, after].filter((n) => Math.abs(lane.times[n] - at) < width);
      return near.map((number) => lane.texts[number]).join(" · ");
    });
    const same = new Map(); // lanes by what they say: drives mostly say the same
    lanes.forEach((lane, row) => {
      const key = lane.kind ? `${row}` : `${lane.run} ${states[row]}`;
      if (states[row]) same.set(key, [...(same.get(key) ?? []), row]);
    });
    return [...same.values()].map(([first, ...more]) => {
      const lane = lanes[first], word = states[first];
      if (lane.kind) return word;
      return more.length > 2 ? `${several ? held.runs[lane.run].name + " " : ""}drives ${word}` : `${[first, ...more].map((row) => laneName(lanes[row])).join(", ")} ${word}`;
    });
  }

  // ---------------------------------------------------------------------------------------- one cursor, one zoom

  function others(u) {
    return plots.filter((plot) => plot.timed && plot.u !== u).map((plot) => plot.u);
  }

  /** Without coming back here for each chart that is changed. */
  function once(change) {
    if (busy) return;
    busy = true;
    try { change(); } finally { busy = false; }
  }

  function zoomed(u) {
    const { min, max } = u.scales.x;
    once(() => others(u).forEach((other) => other.batch(() => other.setScale("x", { min, max }))));
  }

  function reset() {
    full = wholeTime();
    once(() => plots.forEach(({ u, timed, table }) => {
      const [begin, end] = timed ? full : [table()[0][0], table()[0].at(-1)];
      u.batch(() => u.setScale("x", { min: begin, max: Math.max(end, begin + 0.1) }));
    }));
  }

  function pointed(u) {
    const left = u.cursor.left;
    once(() => {
      const time = left >= 0 ? u.posToVal(left, "x") : null;
      for (const other of others(u)) {
        const there = time === null ? NOWHERE : other.valToPos(time, "x");
        other.setCursor({ left: there, top: there < 0 ? NOWHERE : 10 });
      }
      showPlace(time);
      const width = 5 * (u.scales.x.max - u.scales.x.min) / u.over.clientWidth;
      readout.textContent = time === null ? "" : [`${time.toFixed(2)} s`, ...told(time, width)].join(" · ");
    });
  }

  /** The arrows on the map. */
  function showPlace(time) {
    for (const arrow of document.querySelectorAll(".map .here")) {
      const run = Number(arrow.dataset.run), places = held.runs[run].places?.map((number) => columns[number]);
      const row = time === null || !places ? -1 : indexBelow(places[0], time + shift(run));
      arrow.style.display = row < 0 ? "none" : "inline";
      if (row >= 0) arrow.setAttribute("transform", `translate(${places[1][row]} ${places[2][row]}) rotate(${places[3][row]})`);
    }
  }

  /** One finger moves the cursor, two zoom; arrow keys move it, + and - zoom, Escape shows all. */
  function touchable({ u, place }) {
    const fingers = new Map(), at = (event) => event.clientX - u.over.getBoundingClientRect().left;
    let held2 = null;
    u.over.addEventListener("pointerdown", (event) => {
      if (event.pointerType !== "touch") return;
      fingers.set(event.pointerId, at(event));
      held2 = fingers.size === 2 ? [...fingers.values()].map((left) => u.posToVal(left, "x")) : null;
    });
    u.over.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      fingers.set(event.pointerId, at(event));
      const [a, b] = fingers.values(), width = u.over.clientWidth;
      if (held2 === null) return u.setCursor({ left: Math.min(Math.max(a, 0), width), top: 10 });
      if (Math.abs(b - a) < 10) return;
      const scale = (held2[1] - held2[0]) / (b - a);
      if (scale > 0) u.setScale("x", { min: held2[0] - a * scale, max: held2[0] + (width - a) * scale });
    });
    for (const end of ["pointerup", "pointercancel"]) {
      u.over.addEventListener(end, (event) => { fingers.delete(event.pointerId); held2 = null; });
    }
    place.addEventListener("keydown", (event) => {
      const { min, max } = u.scales.x, width = u.over.clientWidth;
      const left = u.cursor.left < 0 ? width / 2 : u.cursor.left, middle = u.posToVal(left, "x");
      const factor = { "+": 0.5, "=": 0.5, "-": 2 }[event.key], step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (step) u.setCursor({ left: Math.min(Math.max(left + step * width / 100, 0), width), top: 10 });
      else if (factor) u.setScale("x", { min: middle + (min - middle) * factor, max: middle + (max - middle) * factor });
      else if (event.key === "Escape") reset();
      else return;
      event.preventDefault();
    });
  }

  // ------------------------------------------------------------------------------------------------ screen, paper

  function sized(width) {
    for (const { u, place } of plots) {
      const wide = width ?? place.clientWidth;
      if (wide > 0) u.batch(() => u.setSize({ width: wide, height: u.height }));
    }
  }

  function recoloured(paper) {
    document.documentElement.classList.toggle("paper", paper);
    inks = {};
    plots.forEach(({ u }) => u.batch(() => u.redraw(true, true)));
  }

  full = wholeTime();
  drawTimeline(document.getElementById("timeline"));
  document.querySelectorAll(".plot[data-chart]").forEach(drawChart);
  reset();
  document.getElementById("unscripted").remove();
  document.getElementById("tools").hidden = false;
  document.getElementById("reset").addEventListener("click", reset);
  const choice = document.getElementById("align");
  choice?.addEventListener("change", () => {
    aligned = Number(choice.value);
    full = wholeTime();
    plots.forEach(({ u, table }) => u.setData(table(), false));
    reset();
  });
  if (choice) aligned = Number(choice.value);
  if (aligned) choice.dispatchEvent(new Event("change"));
  dark.addEventListener("change", () => recoloured(false));
  const printed = [...document.querySelectorAll("details.printed:not([open])")];
  const unfolded = (open) => printed.forEach((part) => { part.open = open; });
  addEventListener("beforeprint", () => { unfolded(true); recoloured(true); sized(PAPER); });
  addEventListener("afterprint", () => { unfolded(false); recoloured(false); sized(); });
  new ResizeObserver(() => sized()).observe(document.getElementById("timeline"));
})();
