// The attitude in three dimensions: the body as it stands in the world, seen from behind its right side.
//
// World: north, east, down. Body: forward, right, down. A length of 1 is nearly half of the picture's shorter side.

import { colour } from "./charts.js";

const rad = Math.PI / 180;
/** Direction from the world to the eye: azimuth from north and height over the horizon, deg. */
const [AZIMUTH, HEIGHT] = [125, 22];
const [ca, sa, ch, sh] = [Math.cos(AZIMUTH * rad), Math.sin(AZIMUTH * rad), Math.cos(HEIGHT * rad), Math.sin(HEIGHT * rad)];
/** Where the light comes from. */
const LIGHT = [-0.3, 0.5, -0.81];
/** Where the ground lies below the body's middle. */
const GROUND = 0.72;

const circle = (count, radius, down) => Array.from({ length: count }, (_, i) => {
  const angle = (2 * Math.PI * i) / count;
  return [radius * Math.cos(angle), radius * Math.sin(angle), down];
});

/** The body's faces: corners and colour. */
function faces() {
  const list = [];
  const [top, bottom] = [circle(8, 0.19, -0.36), circle(8, 0.26, 0.4)];
  for (let i = 0; i < 8; i += 1) {
    const next = (i + 1) % 8;
    list.push([[top[i], top[next], bottom[next], bottom[i]], "slate"]);
  }
  list.push([top, "slate"], [[...bottom].reverse(), "slate"]);
  // The nose: where the body's forward is.
  const [tip, root] = [[0.78, 0, 0], [0.2, 0.11, 0.09]];
  const base = [[root[0], -root[1], -root[2]], [root[0], root[1], -root[2]], [root[0], root[1], root[2]], [root[0], -root[1], root[2]]];
  for (let i = 0; i < 4; i += 1) list.push([[tip, base[i], base[(i + 1) % 4]], "blue"]);
  list.push([circle(20, 0.56, -0.56), "rotor"], [circle(20, 0.56, -0.47), "rotor"]);
  return list;
}

/** Half a rudder's width, where its hinge is, and where its lower edge is when it rests. */
const [WIDE, HINGE, EDGE] = [0.17, 0.42, 0.68];

/** A rudder's face, its angle in deg: that of pitch is hinged along the body's y, that of roll along its x. A positive angle sends the wash forward, or to the left. */
function rudder(isRoll, deg) {
  const [away, down] = [(EDGE - HINGE) * Math.sin(deg * rad), HINGE + (EDGE - HINGE) * Math.cos(deg * rad)];
  const corner = (side, aside, low) => (isRoll ? [side * WIDE, -aside, low] : [aside, side * WIDE, low]);
  return [corner(-1, 0, HINGE), corner(1, 0, HINGE), corner(1, away, down), corner(-1, away, down)];
}

/** The body's legs and mast. */
const LINES = [
  [[0, 0, -0.36], [0, 0, -0.6]],
  ...[45, 135, 225, 315].map((deg) => [[0.2 * Math.cos(deg * rad), 0.2 * Math.sin(deg * rad), 0.3], [0.42 * Math.cos(deg * rad), 0.42 * Math.sin(deg * rad), 0.68]]),
];

/** From body to world: yaw, pitch, roll, deg. */
export function rotation([roll, pitch, yaw]) {
  const [cr, sr, cp, sp, cy, sy] = [roll, pitch, yaw].flatMap((deg) => [Math.cos(deg * rad), Math.sin(deg * rad)]);
  const rows = [
    [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
    [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
    [-sp, cp * sr, cp * cr],
  ];
  return (v) => rows.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
}

/** A place of the world on the picture: to the right, down, and its distance towards the eye. */
export function seen([north, east, down]) {
  const level = north * ca + east * sa;
  return [north * sa - east * ca, down * ch + level * sh, level * ch - down * sh];
}

const minus = (a, b) => a.map((v, i) => v - b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

export class Attitude {
  constructor(canvas) {
    Object.assign(this, { canvas, faces: faces(), last: "" });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.restyle());
    new ResizeObserver(() => { this.last = ""; }).observe(canvas);
    this.restyle();
  }

  restyle() {
    this.colours = Object.fromEntries(["ink", "soft", "line", "slate", "blue", "card", "red"].map((name) => [name, colour(name)]));
    this.last = "";
  }

  /** Roll, pitch and yaw, and the rudders of pitch and roll, deg; null is no number, or no rudder. */
  draw(attitude, rudders = []) {
    const valid = attitude.every((angle) => angle !== null);
    const key = valid ? [...attitude, ...rudders].map((angle) => angle?.toFixed(1)).join() : "invalid";
    if (key === this.last || this.canvas.clientWidth === 0) return;
    this.last = key;
    const context = this.begin();
    if (valid) this.picture(context, attitude, rudders);
    else this.say(context, "attitude invalid");
  }

  /** A clean canvas whose middle is 0 and whose half is 1. */
  begin() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    const half = Math.min(width, height) / 2.25;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    context.setTransform(half, 0, 0, half, width / 2, height / 2);
    context.lineJoin = "round";
    context.lineCap = "round";
    return context;
  }

  say(context, words) {
    context.fillStyle = this.colours.red;
    context.font = "600 0.17px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(words, 0, 0);
  }

  picture(context, attitude, rudders) {
    const { colours } = this;
    const turn = rotation(attitude);
    const path = (points, close) => {
      context.beginPath();
      for (const point of points) context.lineTo(...seen(point).slice(0, 2));
      if (close) context.closePath();
    };
    const line = (points, hue, width, close = false) => {
      path(points, close);
      context.strokeStyle = hue;
      context.lineWidth = width;
      context.stroke();
    };
    // The ground: a compass, and the heading on it.
    const far = circle(48, 1, GROUND);
    line(far, colours.line, 0.02, true);
    const heading = attitude[2] * rad;
    line([[0, 0, GROUND], [Math.cos(heading), Math.sin(heading), GROUND]], colours.soft, 0.015);
    context.font = "0.14px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = colours.soft;
    for (const [words, deg] of [["N", 0], ["E", 90], ["S", 180], ["W", 270]]) {
      context.fillText(words, ...seen([Math.cos(deg * rad), Math.sin(deg * rad), GROUND]).slice(0, 2));
    }
    // Tether and body: what is farther away first.
    const blades = rudders.flatMap((deg, axis) => (deg === null ? [] : [[rudder(axis === 1, deg), "blue"]]));
    const parts = [...this.faces, ...blades].map(([corners, hue]) => {
      const there = corners.map(turn);
      return { there, hue, near: there.reduce((sum, corner) => sum + seen(corner)[2], 0) / there.length };
    });
    for (const ends of [...LINES.map((ends) => ends.map(turn)), [[0, 0, -1], turn([0, 0, -0.6])]]) {
      parts.push({ ends, near: (seen(ends[0])[2] + seen(ends[1])[2]) / 2 });
    }
    parts.sort((a, b) => a.near - b.near);
    for (const { there, ends, hue } of parts) {
      if (ends) {
        line(ends, colours.soft, 0.025);
        continue;
      }
      path(there, true);
      if (hue === "rotor") {
        context.globalAlpha = 0.25;
        context.fillStyle = colours.soft;
        context.fill();
        context.globalAlpha = 1;
        line(there, colours.soft, 0.012, true);
        continue;
      }
      const normal = cross(minus(there[1], there[0]), minus(there[2], there[0]));
      const bright = Math.abs(normal.reduce((sum, v, i) => sum + v * LIGHT[i], 0)) / (Math.hypot(...normal) || 1);
      context.fillStyle = colours[hue];
      context.fill();
      context.globalAlpha = 0.5 * (1 - bright);
      context.fillStyle = "#000";
      context.fill();
      context.globalAlpha = 1;
    }
  }
}
