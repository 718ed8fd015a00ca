// A strip chart: the last seconds of a few values, in buffers whose size never changes.

/** Seconds in sight. */
const SPAN = 20;
/** Values kept of each line: 50 a second and some reserve. */
const KEPT = 1100;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`);

/** A canvas with as many dots as it has on the screen; gives its width and height in CSS pixels. */
function fit(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== across || canvas.height !== down) {
    canvas.width = across;
    canvas.height = down;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** A round step that divides `range` into about `parts`. */
function roundStep(range, parts) {
  const raw = range / parts;
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
}

/** Draws axes and lines; `lines` are `{colour, count, x(i), y(i)}`. */
function draw(canvas, lines, [left, right], [low, high], xName) {
  const { context, width, height } = fit(canvas);
  const [margin, foot] = [44, xName ? 18 : 3];
  const across = (x) => margin + ((x - left) / (right - left)) * (width - margin - 4);
  const down = (y) => 3 + ((high - y) / (high - low)) * (height - 3 - foot);
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  const step = roundStep(high - low, Math.max(2, height / 32));
  for (let y = Math.ceil(low / step) * step; y <= high; y += step) {
    context.strokeStyle = colour("line");
    context.beginPath();
    context.moveTo(margin, down(y));
    context.lineTo(width, down(y));
    context.stroke();
    context.fillStyle = colour("soft");
    context.fillText(String(Number(y.toPrecision(6))), margin - 6, Math.min(Math.max(down(y), 8), height - 8));
  }
  if (xName) {
    context.textAlign = "center";
    const every = roundStep(right - left, 6);
    for (let x = Math.ceil(left / every) * every; x <= right; x += every) {
      context.fillText(String(Number(x.toPrecision(6))), across(x), height - 7);
    }
    context.textAlign = "right";
    context.fillText(xName, width - 4, height - 7);
  }
  context.save();
  context.beginPath();
  context.rect(margin, 0, width - margin, height - foot);
  context.clip();
  context.lineWidth = 1.6;
  for (const line of lines) {
    context.strokeStyle = colour(line.colour);
    context.beginPath();
    // What is no number leaves a gap.
    for (let i = 0, drawing = false; i < line.count; i += 1) {
      const [x, y] = [across(line.x(i)), down(line.y(i))];
      if (drawing) context.lineTo(x, y);
      else context.moveTo(x, y);
      drawing = Number.isFinite(y);
    }
    context.stroke();
  }
  context.restore();
}

/** Least and greatest of what is drawn, not narrower than `least`, with some air. */
function limits(lines, [low, high]) {
  for (const line of lines) {
    for (let i = 0; i < line.count; i += 1) {
      const y = line.y(i);
      if (y < low) low = y;
      if (y > high) high = y;
    }
  }
  const air = 0.06 * (high - low);
  return [low - air, high + air];
}

/** The last seconds of some values. */
export class Strip {
  /** `lines`: `[name, colour]` each; `least`: the range that is always in sight. */
  constructor(parent, title, unit, lines, least, decimals) {
    this.unit = unit;
    this.lines = lines;
    this.least = least;
    this.decimals = decimals;
    this.times = new Float64Array(KEPT);
    this.values = lines.map(() => new Float32Array(KEPT));
    this.begin = 0;
    this.count = 0;
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    const name = document.createElement("span");
    name.textContent = `${title}, ${unit}`;
    caption.append(name);
    if (lines.length > 1) {
      for (const [words, hue] of lines) {
        const key = document.createElement("span");
        key.textContent = `— ${words}`;
        key.style.color = `var(--${hue})`;
        caption.append(key);
      }
    }
    this.now = document.createElement("b");
    this.canvas = document.createElement("canvas");
    caption.append(this.now);
    figure.append(caption, this.canvas);
    parent.append(figure);
  }

  /** Takes in a value of each line; `null` is no number. A clock that went back is a vehicle that began anew. */
  push(time, values) {
    if (this.count > 0 && time < this.times[(this.begin + this.count - 1) % KEPT]) this.count = 0;
    const at = (this.begin + this.count) % KEPT;
    this.times[at] = time;
    values.forEach((value, line) => { this.values[line][at] = value ?? NaN; });
    if (this.count < KEPT) this.count += 1;
    else this.begin = (this.begin + 1) % KEPT;
    this.newest = values[0];
  }

  /** Shows it. */
  draw() {
    if (this.count === 0) return;
    const end = this.times[(this.begin + this.count - 1) % KEPT];
    const at = (i) => (this.begin + i) % KEPT;
    const lines = this.lines.map(([, hue], line) => ({
      colour: hue,
      count: this.count,
      x: (i) => this.times[at(i)],
      y: (i) => this.values[line][at(i)],
    })).reverse();
    draw(this.canvas, lines, [end - SPAN, end], limits(lines, this.least), "");
    this.now.textContent = this.newest === null ? "invalid" : `${this.newest.toFixed(this.decimals)} ${this.unit}`;
  }
}

/** A whole trace: rows of time and values, a colour for each value. */
export function drawTrace(canvas, rows, hues) {
  const lines = hues.map((hue, column) => ({
    colour: hue,
    count: rows.length,
    x: (i) => rows[i][0],
    y: (i) => rows[i][column + 1],
  }));
  draw(canvas, lines, [0, rows[rows.length - 1][0]], limits(lines, [-1, 1]), "s");
}
