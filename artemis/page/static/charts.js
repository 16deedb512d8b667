// Time series of the last minutes, one cursor over all of them (uPlot).
const box = document.getElementById('charts');
const LIGHT = ['#0072b2', '#d55e00', '#009e73', '#cc79a7'], DARK = ['#56b4e9', '#e69f00', '#2fd3a0', '#e7a3c8']; // after Okabe and Ito
const dark = matchMedia('(prefers-color-scheme: dark)'), WINDOW = 60, MOST = 3600;
let columns = [], plots = [], names = [], zoomed = false, timer = null;
const turn = values => values.map(value => value === null ? null : value * 180 / Math.PI);
const dash = [[], [6, 3], [2, 2], [8, 3, 2, 3]];

export async function begin(about) {
  names = about.series;
  columns = [];
  const early = names.map(() => []);
  try {
    const answer = await fetch('/history'), rows = answer.ok ? await answer.json() : [];
    columns = early;
    rows.forEach(push);
  } catch { columns = early; /* only what comes from now on */ }
  if (visible) show(true);
}
export function see(sample) {
  const last = columns[0]?.at(-1);
  if (!columns.length) return;
  if (last !== undefined && sample[0] < last - 1) columns = names.map(() => []); // another run
  if (last === undefined || sample[0] - last >= 0.1) push(sample);
}
function push(row) {
  row.forEach((value, index) => columns[index].push(value));
  if (columns[0].length > MOST) columns = columns.map(column => column.slice(-MOST + 600));
}

function groups() {
  const at = name => names.indexOf(name), drives = names.slice(7);
  return [
    {title: 'Speed [m/s]', series: [['driven', at('speed')], ['commanded', at('wished')]]},
    {title: 'Steering [degrees, left positive]', series: [['angle', at('steering')]], convert: turn},
    {title: 'Cross-track error [m, left positive]', series: [['cross-track', at('cross_track')]]},
    {title: 'Motor currents [A]', series: drives.map((name, index) => [name, 7 + index])},
    {title: 'Battery [V]', series: [['battery', at('battery')]]},
    {title: 'Tick lateness [ms]', series: [['late', at('late')]]},
  ].filter(group => group.series.some(([, index]) => columns[index]?.some(value => value !== null)));
}

let visible = false;
export function show(on) {
  visible = on;
  clearInterval(timer);
  if (!on) return;
  draw();
  timer = setInterval(draw, 250);
}

function draw() {
  if (!columns.length || !columns[0].length) return;
  const wanted = groups();
  if (plots.length !== wanted.length) make(wanted);
  plots.forEach(({plot, group}) => plot.setData([columns[0], ...group.series.map(([, index]) => group.convert ? group.convert(columns[index]) : columns[index])], false));
  const end = columns[0].at(-1);
  if (!zoomed) for (const {plot} of plots) plot.setScale('x', {min: Math.max(columns[0][0], end - WINDOW), max: end});
}

function make(wanted) {
  for (const {plot} of plots) plot.destroy();
  box.querySelectorAll('figure').forEach(figure => figure.remove());
  const style = getComputedStyle(document.documentElement), text = style.getPropertyValue('--text').trim(), grid = style.getPropertyValue('--line').trim();
  const axis = {stroke: text, grid: {stroke: grid, width: 1}, ticks: {stroke: grid}, font: '12px system-ui, "DejaVu Sans", sans-serif'};
  plots = wanted.map(group => {
    const figure = document.createElement('figure'), caption = document.createElement('figcaption');
    caption.textContent = group.title;
    figure.append(caption);
    box.append(figure);
    const plot = new uPlot({
      width: Math.max(box.clientWidth - 24, 240), height: 150,
      cursor: {sync: {key: 'run'}, drag: {x: true, y: false}},
      scales: {x: {time: false}, y: {range: (chart, low, high) => low === high ? [low - 1, high + 1] : uPlot.rangeNum(low, high, 0.1, true)}},
      legend: {live: true},
      hooks: {setSelect: [chart => { if (chart.select.width > 4) zoomed = true; }]},
      axes: [{...axis, values: (chart, ticks) => ticks.map(tick => `${tick} s`)}, {...axis, size: 52}],
      series: [{label: 'time', value: (chart, value) => value === null ? '–' : `${value.toFixed(2)} s`}, ...group.series.map(([label], index) => ({
        label, stroke: (dark.matches ? DARK : LIGHT)[index % LIGHT.length], width: 2, dash: dash[index % dash.length], spanGaps: false,
        value: (chart, value) => value === null || value === undefined ? '–' : value.toFixed(2),
      }))],
    }, [columns[0], ...group.series.map(() => [])], figure);
    plot.over.addEventListener('dblclick', () => { zoomed = false; draw(); });
    return {plot, group};
  });
}
dark.addEventListener('change', () => { plots.forEach(({plot}) => plot.destroy()); plots = []; });
new ResizeObserver(() => { for (const {plot} of plots) plot.setSize({width: Math.max(box.clientWidth - 24, 240), height: 150}); }).observe(box);
