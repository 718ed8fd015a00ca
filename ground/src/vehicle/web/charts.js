// Charts of the last minute, drawn by uPlot: a time axis, pause, zoom, and a cursor with values.

import { make } from "./dom.js";

/** Seconds in sight, from close to far. */
const SPANS = [2, 5, 10, 20, 60];
/** Seconds kept, at most while something is looked at, and how many more before the oldest are dropped. */
const [KEPT, PAUSED, SURPLUS] = [60, 600, 10];
/** Time without a frame over which no line is drawn, s. */
const GAP = 1.5;
/** Between two changes of the values in words, ms: faster ones cannot be read. */
const WORDS = 150;
/** Pictures from one drawing of a slow chart to the next. */
const SLOW = 6;
/** Width of the value axis, px: the same for all charts, so that their time axes stand below each other. */
const AXIS = 46;

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** What every chart has: axes, grid, no legend of uPlot's own. */
export function style(x, y) {
  const axis = (more) => ({
    stroke: colour("soft"), font: "11px system-ui, sans-serif",
    grid: { stroke: colour("line"), width: 1 }, ticks: { show: false }, ...more,
  });
  return { legend: { show: false }, axes: [axis({ size: 20, gap: 2, ...x }), axis({ size: AXIS, gap: 4, ...y })] };
}

/**
 * One chart. `lines`: name, colour and value of a frame each. `least`: the range that is always in sight.
 * `slow`: it is drawn less often. `when`: frames with which it is there.
 */
class Strip {
  constructor(charts, { title, unit, lines, least, decimals, height, slow, when }) {
    Object.assign(this, { charts, unit, lines, least, decimals, height, slow, when, words: "", inSight: true });
    this.values = lines.map(() => []);
    const caption = make("figcaption", {}, make("span", { textContent: `${title}, ${unit}` }));
    for (const [name, hue] of lines.length > 1 ? lines : []) {
      const key = make("span", { textContent: `— ${name}` });
      key.style.color = `var(--${hue})`;
      caption.append(key);
    }
    this.now = make("b");
    caption.append(this.now);
    this.place = make("div");
    this.figure = make("figure", { hidden: Boolean(when) }, caption, this.place);
    charts.parent.append(this.figure);
  }

  /** The chart anew, in the colours of light or dark. */
  build() {
    this.plot?.destroy();
    const { charts } = this;
    this.plot = new uPlot({
      ...style({ values: (_, ticks) => ticks.map((tick) => `${tick} s`), space: 70 }, { space: 24 }),
      width: this.place.clientWidth || 300, height: this.height,
      padding: [4, 8, 0, 0],
      series: [{}, ...this.lines.map(([, hue]) => ({ stroke: colour(hue), width: 1, points: { show: false } }))],
      scales: {
        x: { time: false, auto: false, min: 0, max: 1 },
        y: { range: (plot) => this.range(plot) },
      },
      cursor: {
        sync: { key: "charts" }, y: false, points: { show: false },
        drag: { x: true, y: false, setScale: false },
        bind: { dblclick: () => () => charts.resume() },
      },
      hooks: {
        drawClear: [(plot) => charts.shade(plot)],
        setSelect: [(plot) => {
          const { left, width } = plot.select;
          if (width > 3) charts.look(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
          plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        }],
        setCursor: [() => this.say()],
      },
    }, [charts.times, ...this.values], this.place);
  }

  /** Least and greatest of what is in sight, with a margin. What is no number counts as 0, which is always in sight. */
  range(plot) {
    const [from, to] = plot.series[0].idxs ?? [0, -1];
    let [low, high] = this.least;
    for (const values of this.values) {
      for (let i = from; i <= to; i += 1) {
        if (values[i] < low) low = values[i];
        if (values[i] > high) high = values[i];
      }
    }
    const margin = 0.06 * (high - low);
    return [low - margin, high + margin];
  }

  draw([from, to]) {
    if (!this.inSight) return;
    this.plot.batch(() => {
      this.plot.setData([this.charts.times, ...this.values], false);
      this.plot.setScale("x", { min: from, max: to });
    });
  }

  /** The values at the cursor, the newest ones without it. */
  say() {
    const { times } = this.charts;
    const cursor = this.plot.cursor.left >= 0 ? this.plot.cursor.idx : null;
    const at = cursor ?? times.length - 1;
    if (times[at] === undefined) return;
    const word = (values) => (values[at] === null ? "invalid" : values[at].toFixed(this.decimals));
    const values = (cursor === null ? this.values.slice(0, 1) : this.values).map(word).join(" · ");
    const words = `${cursor === null ? "" : `at ${times[at].toFixed(2)} s: `}${values} ${this.unit}`;
    if (words !== this.words) this.now.textContent = words;
    this.words = words;
  }
}

/** All charts, over one time. */
export class Charts {
  /** `kinds`: what [`Strip`] takes; `buttons` by their names. */
  constructor(parent, kinds, buttons) {
    Object.assign(this, { parent, buttons, times: [], settling: [], span: 20, view: null, spoken: 0, turn: 0 });
    this.strips = kinds.map((kind) => new Strip(this, kind));
    const press = { pause: () => this.toggle(), closer: () => this.zoom(-1), farther: () => this.zoom(1), earlier: () => this.shift(-0.5), later: () => this.shift(0.5) };
    for (const [name, act] of Object.entries(press)) {
      buttons[name].addEventListener("click", () => { act(); this.renew(); this.draw(performance.now()); });
    }
    this.build();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.build());
    new ResizeObserver(() => this.fit()).observe(parent);
    const watch = new IntersectionObserver((seen) => {
      for (const { target, isIntersecting } of seen) {
        this.strips.find((strip) => strip.figure === target).inSight = isIntersecting;
      }
      this.renew();
    });
    for (const strip of this.strips) watch.observe(strip.figure);
    parent.addEventListener("keydown", (event) => this.key(event));
    this.showButtons();
  }

  build() {
    for (const strip of this.strips) strip.build();
    this.renew();
  }

  /** All is drawn again, even what is paused. */
  renew() {
    this.changed = true;
    this.drawn = undefined;
  }

  fit() {
    for (const { plot, place, height } of this.strips) {
      if (place.clientWidth > 0 && place.clientWidth !== plot.width) plot.setSize({ width: place.clientWidth, height });
    }
    this.renew();
  }

  /** Takes in a frame. If its time is earlier than the last one's, the vehicle has restarted. */
  push(time, frame) {
    const { times } = this;
    if (time < times.at(-1)) {
      for (const values of [times, this.settling, ...this.strips.flatMap((strip) => strip.values)]) values.length = 0;
      this.resume();
    }
    if (time - times.at(-1) > GAP) this.append(times.at(-1) + GAP / 2, () => null);
    this.append(time, (of) => of(frame) ?? null);
    const oldest = Math.max(Math.min(time - KEPT, this.view?.[0] ?? time), time - PAUSED);
    if (times[0] < oldest - SURPLUS) {
      const count = times.findIndex((at) => at >= oldest);
      for (const values of [times, ...this.strips.flatMap((strip) => strip.values)]) values.splice(0, count);
    }
    this.settle(time, frame.settling);
    this.changed = true;
    this.choose(frame);
  }

  /** Keeps the stretches of time, from and to, in which the estimate begins anew. */
  settle(time, isSettling) {
    const last = this.settling.at(-1);
    if (isSettling && last?.open) last.to = time;
    else if (isSettling) this.settling.push({ from: time, to: time, open: true });
    else if (last?.open) Object.assign(last, { to: time, open: false });
    while (this.settling[0]?.to < this.times[0]) this.settling.shift();
    this.buttons.settling.hidden = this.settling.length === 0;
  }

  /** Draws them below a chart. */
  shade(plot) {
    const { ctx, bbox, scales } = plot;
    ctx.save();
    ctx.fillStyle = colour("line");
    for (const { from, to } of this.settling) {
      const [left, right] = [from, to].map((time) => Math.min(Math.max(time, scales.x.min), scales.x.max)).map((time) => plot.valToPos(time, "x", true));
      if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
    ctx.restore();
  }

  /** Charts that only some vehicles have come and go with what a frame tells. */
  choose(frame) {
    const turned = this.strips.filter(({ when, figure }) => when && figure.hidden === Boolean(when(frame)));
    for (const { figure } of turned) figure.hidden = !figure.hidden;
    if (turned.length > 0) this.fit();
  }

  append(time, value) {
    this.times.push(time);
    for (const { lines, values } of this.strips) lines.forEach(([, , of], line) => values[line].push(value(of)));
  }

  /** Draws, if anything has changed. */
  draw(now) {
    if (!this.changed || this.times.length === 0) return;
    const end = this.times.at(-1);
    // A chart that is paused does not change by what comes.
    if (this.view === null || this.drawn !== this.view) {
      const all = this.drawn === undefined || this.view !== null;
      this.turn = (this.turn + 1) % SLOW;
      for (const strip of this.strips) {
        if (all || !strip.slow || this.turn === 0) strip.draw(this.view ?? [end - this.span, end]);
      }
    }
    this.drawn = this.view;
    this.changed = false;
    if (now - this.spoken < WORDS) return;
    this.spoken = now;
    for (const strip of this.strips) strip.say();
  }

  /** Looks at a stretch of time; new values go on being kept. */
  look(from, to) {
    const half = Math.min(Math.max(to - from, 0.2), KEPT) / 2;
    const middle = Math.min(Math.max((from + to) / 2, this.times[0] ?? 0), this.times.at(-1) ?? 0);
    this.view = [middle - half, middle + half];
    this.changed = true;
    this.showButtons();
  }

  resume() {
    this.view = null;
    this.changed = true;
    this.showButtons();
  }

  toggle() {
    const end = this.times.at(-1) ?? 0;
    if (this.view) this.resume();
    else this.look(end - this.span, end + 1e-9);
  }

  zoom(direction) {
    if (this.view) {
      const [from, to] = this.view;
      const grow = (to - from) * (direction > 0 ? 0.5 : -0.25);
      return this.look(from - grow, to + grow);
    }
    const next = SPANS.indexOf(this.span) + direction;
    this.span = SPANS[Math.min(Math.max(next, 0), SPANS.length - 1)];
  }

  shift(share) {
    const end = this.times.at(-1) ?? 0;
    const [from, to] = this.view ?? [end - this.span, end];
    this.look(from + share * (to - from), to + share * (to - from));
  }

  /** Left and right move the cursor over a chart that has the focus. */
  key(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || event.target !== this.parent) return;
    event.preventDefault();
    const { plot } = this.strips[0];
    if (!this.view) this.toggle();
    const width = plot.over.clientWidth;
    const left = plot.cursor.left >= 0 ? plot.cursor.left : width / 2;
    plot.setCursor({ left: Math.min(Math.max(left + step * (event.shiftKey ? 20 : 2), 0), width - 1), top: 1 });
  }

  showButtons() {
    this.buttons.pause.textContent = this.view ? "Resume" : "Pause";
  }
}
