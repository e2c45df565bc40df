'use strict';

// Okabe and Ito's palette, lifted for a dark ground: told apart by every kind of colour vision.
const COLOURS = {
  sky: '#56b4e9', orange: '#e69f00', vermilion: '#f0743a', green: '#2fc79b', grey: '#aab6c2',
  line: '#25313d', soft: '#93a3b3', ink: '#e8eef4',
};
const SERIES = [COLOURS.sky, COLOURS.orange, COLOURS.green, COLOURS.vermilion];
const KEPT_S = 32;
const SILENT_MS = 2000;
const PAD = { left: 72, right: 14, top: 10, bottom: 30 };

const byId = (id) => document.getElementById(id);
const kept = { error: [], state: [], command: [], samples: [], events: [] };
let newest = {};
let scenario = null;
let time = 0;
let frames = 0;
let movedAt = 0;
let paused = false;
let dirty = true;

// -- data ------------------------------------------------------------------------------------------

function forget() {
  for (const name of Object.keys(kept)) kept[name] = [];
  time = 0;
}

function take(frame) {
  if (frame.fault) {
    byId('subtitle').textContent = frame.fault;
    return;
  }
  if (frame.restart) {
    forget();
    scenario = null;
  }
  if (frame.time > time || frame.restart) movedAt = performance.now();
  time = Math.max(time, frame.time);
  for (const name of Object.keys(kept)) {
    const list = kept[name];
    for (const entry of frame[name]) list.push(entry);
    let old = 0;
    while (old < list.length && list[old][0] < time - KEPT_S) old += 1;
    if (old > 500 || old === list.length) list.splice(0, old);
  }
  if (frame.scenario) scenario = frame.scenario;
  if (!frame.restart && frames) {
    for (const last of ['ratio', 'in_sector', 'within_tolerance']) frame[last] ??= newest[last];
    if (!frame.pixels.length) frame.pixels = newest.pixels;
  }
  newest = frame;
  frames += 1;
  dirty = true;
}

function connect() {
  const source = new EventSource('/stream');
  source.addEventListener('past', (event) => {
    forget();
    for (const frame of JSON.parse(event.data)) take(frame);
    // Frames of the past do not show that the loop runs now.
    if (movedAt) movedAt = -Infinity;
  });
  source.onmessage = (event) => take(JSON.parse(event.data));
  source.onopen = () => { source.connected = true; };
  source.onerror = () => { source.connected = false; };
  return source;
}

// -- axes ------------------------------------------------------------------------------------------

function niceTicks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw) || 10 * power;
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
    ticks.push(k * step);
  }
  return { ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function padded(low, high, least) {
  const middle = (low + high) / 2;
  const half = Math.max((high - low) * 0.55, least, Math.abs(middle) * 1e-6);
  return [middle - half, middle + half];
}

class Plot {
  constructor(id) {
    this.canvas = byId(id);
    this.context = this.canvas.getContext('2d');
    new ResizeObserver(() => { dirty = true; }).observe(this.canvas);
  }

  begin() {
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    if (this.canvas.width !== Math.round(this.width * ratio)
        || this.canvas.height !== Math.round(this.height * ratio)) {
      this.canvas.width = Math.round(this.width * ratio);
      this.canvas.height = Math.round(this.height * ratio);
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, this.width, this.height);
    this.inner = { x: PAD.left, y: PAD.top, w: this.width - PAD.left - PAD.right,
      h: this.height - PAD.top - PAD.bottom };
  }

  scale(xRange, yRange, log = false) {
    const f = log ? Math.log10 : (v) => v;
    const [x0, x1] = xRange;
    const [y0, y1] = yRange.map(f);
    this.x = (v) => this.inner.x + ((v - x0) / (x1 - x0)) * this.inner.w;
    this.y = (v) => this.inner.y + (1 - (f(v) - y0) / (y1 - y0)) * this.inner.h;
  }

  axes(xRange, yRange, { log = false, xLabel = 'time [s]', yLabel = '', yTicks = null } = {}) {
    this.scale(xRange, yRange, log);
    const c = this.context;
    c.font = '12px system-ui, sans-serif';
    c.lineWidth = 1;
    c.strokeStyle = COLOURS.line;
    c.fillStyle = COLOURS.soft;
    c.textAlign = 'center';
    c.textBaseline = 'top';
    const xs = niceTicks(...xRange, Math.max(2, this.inner.w / 70));
    for (const tick of xs.ticks) {
      this.rule(this.x(tick), this.inner.y, this.x(tick), this.inner.y + this.inner.h);
      c.fillText(tick.toFixed(xs.digits), this.x(tick), this.inner.y + this.inner.h + 6);
    }
    c.textAlign = 'right';
    c.fillText(xLabel, this.width - PAD.right, this.height - 11);
    this.upwards(yLabel);
    c.textAlign = 'right';
    c.textBaseline = 'middle';
    for (const [value, label] of yTicks || this.valueTicks(yRange, log)) {
      this.rule(this.inner.x, this.y(value), this.inner.x + this.inner.w, this.y(value));
      c.fillText(label, this.inner.x - 8, this.y(value));
    }
    c.save();
    c.beginPath();
    c.rect(this.inner.x, this.inner.y, this.inner.w, this.inner.h);
    c.clip();
  }

  valueTicks(range, log) {
    if (!log) {
      const { ticks, digits } = niceTicks(...range, Math.max(2, this.inner.h / 28));
      return ticks.map((tick) => [tick, tick.toFixed(digits)]);
    }
    const ticks = [];
    for (let p = Math.floor(Math.log10(range[0])); p <= Math.log10(range[1]); p += 1) {
      for (const k of [1, 2, 5]) {
        const value = k * 10 ** p;
        const label = k === 1 || range[1] / range[0] < 300 ? value.toFixed(Math.max(0, -p)) : '';
        if (value >= range[0] && value <= range[1]) ticks.push([value, label]);
      }
    }
    return ticks;
  }

  upwards(text) {
    const c = this.context;
    c.save();
    c.translate(14, this.inner.y + this.inner.h / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    c.fillText(text, 0, 0);
    c.restore();
  }

  rule(x0, y0, x1, y1) {
    const c = this.context;
    c.beginPath();
    c.moveTo(x0, y0);
    c.lineTo(x1, y1);
    c.stroke();
  }

  curve(points, xOf, yOf, colour, { step = false, width = 1.8 } = {}) {
    const c = this.context;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.lineJoin = 'round';
    c.beginPath();
    let y = 0;
    points.forEach((point, i) => {
      const px = this.x(xOf(point));
      if (step && i) c.lineTo(px, y);
      y = this.y(yOf(point));
      if (i) c.lineTo(px, y); else c.moveTo(px, y);
    });
    c.stroke();
  }

  dashed(draw, colour) {
    const c = this.context;
    c.save();
    c.setLineDash([7, 5]);
    c.lineWidth = 1.6;
    c.strokeStyle = colour;
    draw(c);
    c.restore();
  }

  end() { this.context.restore(); }
}

const plots = {};
for (const id of ['error', 'phase', 'events', 'estimate', 'command']) plots[id] = new Plot(id);

// -- drawing ---------------------------------------------------------------------------------------

function timeWindow() {
  const length = Number(byId('window').value);
  return time < length ? [0, length] : [time - length, time];
}

function visible(list, [from, to]) {
  let first = 0;
  while (first < list.length - 1 && list[first + 1][0] < from) first += 1;
  return list.slice(first).filter((entry) => entry[0] <= to);
}

function extent(values, least) {
  if (!values.length) return [0, 1];
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return padded(low, high, least);
}

function drawError(plot, span) {
  const points = visible(kept.error, span).filter((p) => p[1] > 0);
  const values = points.map((p) => p[1]);
  if (scenario) values.push(scenario.tolerance);
  const low = values.length ? Math.min(...values) / 1.5 : 1e-3;
  const high = values.length ? Math.max(...values) * 1.5 : 1;
  plot.axes(span, [low, high], { log: true, yLabel: 'state units' });
  if (scenario) {
    const y = plot.y(scenario.tolerance);
    plot.dashed(() => plot.rule(plot.inner.x, y, plot.inner.x + plot.inner.w, y), COLOURS.vermilion);
  }
  plot.curve(points, (p) => p[0], (p) => p[1], COLOURS.sky);
  plot.end();
}

function drawPhase(plot, span) {
  const points = visible(kept.state, span);
  const planar = points.length && points[0].length > 2;
  const xOf = planar ? (p) => p[1] : (p) => p[0];
  const yOf = planar ? (p) => p[2] : (p) => p[1];
  const target = scenario && planar ? scenario.set_point : null;
  const reach = target ? 1.35 * scenario.tolerance : 1e-3;
  let xr = extent([...points.map(xOf), ...(target ? [target[0]] : [])], reach);
  let yr = extent([...points.map(yOf), ...(target ? [target[1]] : [])], reach);
  if (!planar) xr = span;
  else {
    // One unit is as long in both directions: the eps ball is a circle.
    const unit = Math.max((xr[1] - xr[0]) / plot.inner.w, (yr[1] - yr[0]) / plot.inner.h) / 2;
    const [mx, my] = [(xr[0] + xr[1]) / 2, (yr[0] + yr[1]) / 2];
    xr = [mx - unit * plot.inner.w, mx + unit * plot.inner.w];
    yr = [my - unit * plot.inner.h, my + unit * plot.inner.h];
  }
  const states = planar ? points[0].length - 1 : 1;
  const hidden = states > 2 ? `; not shown: x3${states > 3 ? ` to x${states}` : ''}` : '';
  plot.axes(xr, yr, planar
    ? { xLabel: `x₁ [state units]${hidden}`, yLabel: 'x₂ [state units]' }
    : { yLabel: 'x₁ [state units]' });
  const c = plot.context;
  if (target) {
    const radius = Math.abs(plot.x(scenario.tolerance) - plot.x(0));
    const [tx, ty] = [plot.x(target[0]), plot.y(target[1])];
    c.fillStyle = 'rgba(240, 116, 58, .08)';
    c.beginPath();
    c.arc(tx, ty, radius, 0, 2 * Math.PI);
    c.fill();
    plot.dashed(() => { c.beginPath(); c.arc(tx, ty, radius, 0, 2 * Math.PI); c.stroke(); },
      COLOURS.vermilion);
    c.strokeStyle = COLOURS.vermilion;
    plot.rule(tx - 6, ty, tx + 6, ty);
    plot.rule(tx, ty - 6, tx, ty + 6);
  }
  plot.curve(points, xOf, yOf, COLOURS.sky, { width: 1.5 });
  if (points.length) {
    const last = points[points.length - 1];
    c.fillStyle = COLOURS.green;
    c.beginPath();
    c.arc(plot.x(xOf(last)), plot.y(yOf(last)), 5, 0, 2 * Math.PI);
    c.fill();
  }
  plot.end();
}

function drawEvents(plot, span) {
  const marks = visible(kept.events, span);
  const seen = marks.reduce((most, mark) => Math.max(most, mark[1]), 0);
  const count = Math.max(scenario ? scenario.pixels : 1, seen + 1);
  const ticks = niceTicks(0, Math.max(count - 1, 1), Math.min(count, Math.max(2, plot.inner.h / 30)));
  const labels = ticks.ticks.filter((t) => Number.isInteger(t) && t < count);
  plot.axes(span, [-0.7, count - 0.3], { yTicks: labels.map((t) => [t, `pixel ${t}`]) });
  const c = plot.context;
  const row = Math.abs(plot.y(1) - plot.y(0));
  const reach = Math.min(Math.max(row * 0.42, 1.5), 16);
  // ON goes up and OFF goes down, so that not colour alone separates them.
  for (const [polarity, colour] of [[1, COLOURS.orange], [-1, COLOURS.sky]]) {
    c.strokeStyle = colour;
    c.lineWidth = 1.6;
    c.beginPath();
    for (const [t, pixel, sign] of marks) {
      if (sign === polarity) {
        c.moveTo(plot.x(t), plot.y(pixel));
        c.lineTo(plot.x(t), plot.y(pixel) - polarity * reach);
      }
    }
    c.stroke();
  }
  plot.end();
}

function drawEstimate(plot, span) {
  const choice = Math.max(0, (newest.pixels || []).indexOf(Number(byId('pixel').value)));
  const points = visible(kept.samples, span).filter((p) => p[1].length > choice);
  const values = points.flatMap((p) => [p[1][choice], p[2][choice]]);
  plot.axes(span, extent(values, 1e-4), { yLabel: 'luminosity units' });
  plot.curve(points, (p) => p[0], (p) => p[1][choice], COLOURS.grey, { width: 2.4 });
  plot.curve(points, (p) => p[0], (p) => p[2][choice], COLOURS.orange, { step: true });
  plot.end();
}

function drawCommand(plot, span) {
  const points = visible(kept.command, span);
  const inputs = points.length ? points[0].length - 1 : 0;
  plot.axes(span, extent(points.flatMap((p) => p.slice(1)), 1e-3), { yLabel: 'input units' });
  for (let i = inputs - 1; i >= 0; i -= 1) {
    plot.curve(points, (p) => p[0], (p) => p[i + 1], SERIES[i % SERIES.length], { step: true });
  }
  plot.end();
  legend(inputs);
}

function legend(inputs) {
  const host = byId('command-legend');
  if (host.dataset.inputs === String(inputs)) return;
  host.dataset.inputs = String(inputs);
  host.replaceChildren();
  const classes = ['sky', 'orange', 'green', 'vermilion'];
  for (let i = 0; i < inputs; i += 1) {
    const mark = document.createElement('em');
    mark.className = `${classes[i % classes.length]} line`;
    host.append(mark, `u${i + 1}`);
  }
}

// -- figures ---------------------------------------------------------------------------------------

function put(id, text) { if (byId(id).textContent !== text) byId(id).textContent = text; }

function judge(id, good) {
  byId(id).classList.toggle('good', good === true);
  byId(id).classList.toggle('bad', good === false);
}

function choosePixels() {
  const select = byId('pixel');
  const pixels = newest.pixels || [];
  if (!pixels.length || select.dataset.pixels === pixels.join()) return;
  select.dataset.pixels = pixels.join();
  const before = Number(select.value);
  select.replaceChildren(...pixels.map((pixel) => new Option(String(pixel), String(pixel))));
  if (pixels.includes(before)) select.value = String(before);
}

function showFigures() {
  if (!frames) return;
  const error = kept.error.length ? kept.error[kept.error.length - 1][1] : null;
  put('value-time', time.toFixed(2));
  put('value-error', error === null ? '–' : error.toPrecision(3));
  put('value-tolerance', scenario ? `tolerance ε = ${scenario.tolerance}` : 'set-point unknown');
  judge('tile-error', newest.within_tolerance);
  const { ratio } = newest;
  put('value-ratio', ratio === undefined || ratio === null ? '–' : ratio.toFixed(3));
  judge('tile-ratio', newest.in_sector);
  if (newest.certificate) {
    const [word, budget] = newest.certificate.split(': ');
    put('value-certificate', newest.certified ? 'holds' : 'none');
    put('note-certificate', `${word}: ${budget}`);
    judge('tile-certificate', newest.certified);
  } else {
    put('value-certificate', '–');
    put('note-certificate', 'not reported yet');
    judge('tile-certificate', null);
  }
  put('value-events', (newest.total_events || 0).toLocaleString('en'));
  const share = newest.total_events ? (100 * newest.on_events) / newest.total_events : null;
  put('value-share', `${Math.round(newest.events_per_second)} a second, `
    + `${share === null ? '–' : share.toFixed(0)} % ON`);
  put('value-lost', String(newest.lost_events));
  put('note-lost', newest.camera_restarts
    ? `the camera started again (${newest.camera_restarts})` : 'by the running index');
  judge('tile-lost', newest.lost_events === 0 && newest.camera_restarts === 0);
  put('value-cycles', newest.cycles_per_second.toFixed(0));
  put('value-speed', newest.real_time_factor.toFixed(2));
  put('thinned', newest.events_a_mark > 1 ? `one mark for ${newest.events_a_mark} events` : '');
  if (scenario) {
    put('subtitle', `${scenario.pixels} pixels · h = ${scenario.event_threshold} · `
      + `${scenario.method} · ${scenario.mode}`);
  } else put('subtitle', 'waiting for the nodes\' parameters (or give --params-file)');
  choosePixels();
  document.body.dataset.frames = String(frames);
}

function showStatus(source) {
  const status = byId('status');
  let [state, text] = ['live', 'live'];
  if (source.readyState !== EventSource.OPEN) [state, text] = ['lost', 'connection lost'];
  else if (!movedAt) [state, text] = ['silent', 'no loop received'];
  else if (performance.now() - movedAt > SILENT_MS) [state, text] = ['silent', 'loop is silent'];
  if (paused && state === 'live') text = 'live, paused here';
  status.dataset.state = state;
  put('status', text);
}

function draw() {
  if (dirty && !paused) {
    dirty = false;
    for (const plot of Object.values(plots)) plot.begin();
    const span = timeWindow();
    drawError(plots.error, span);
    drawPhase(plots.phase, span);
    drawEvents(plots.events, span);
    drawEstimate(plots.estimate, span);
    drawCommand(plots.command, span);
    showFigures();
  }
  requestAnimationFrame(draw);
}

const source = connect();
setInterval(() => showStatus(source), 250);
for (const id of ['window', 'pixel']) byId(id).addEventListener('change', () => { dirty = true; });
byId('pause').addEventListener('click', () => {
  paused = !paused;
  byId('pause').setAttribute('aria-pressed', String(paused));
  byId('pause').textContent = paused ? 'Go on' : 'Pause';
  dirty = true;
});
requestAnimationFrame(draw);
