// The page of `tvc web`: what comes from the program is shown, what is pressed is sent.

import { Strip, drawTrace } from "./chart.js";
import { Link } from "./link.js";
import { Logs, nameOf } from "./logs.js";
import { Parameters } from "./parameters.js";
import { RigPanel } from "./rig.js";
import { Stop } from "./stop.js";
import { TITLES, rowsOf } from "./tests.js";

const at = (id) => document.getElementById(id);
/** Texts in sight. */
const TEXTS = 100;
/** Between two drawings of the charts, ms. */
const DRAW = 40;
/** Silence of the program after which the page says so, ms. */
const SILENCE = 1500;

let frame = null;
let shown = 0;
let condition = {};
let trial = {};
let heard = performance.now();
let drawn = 0;

// The token stands in the address behind #, where no request carries it.
const token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";
addEventListener("hashchange", () => location.reload());
// A page that is connected anew is told every text again.
const link = new Link(token, () => at("texts").replaceChildren(), show);

// Orders

const stop = new Stop(() => link.order("stop"), (words, kind) => {
  // Set once, it is read out once.
  if (at("stopped").textContent !== words) at("stopped").textContent = words;
  at("stopped").className = kind;
});

/** Sends a button's order and tells how it went. */
async function press(order, words) {
  const { error } = await link.order(order);
  const answer = at("answer");
  answer.textContent = error ?? `${words}: done`;
  answer.classList.toggle("done", error === undefined);
  clearTimeout(press.timer);
  press.timer = setTimeout(() => { answer.textContent = ""; }, error ? 8000 : 2000);
}

at("stop").addEventListener("pointerdown", () => stop.pressed());
at("stop").addEventListener("click", (event) => {
  // By keyboard; the pointer has been heard already.
  if (event.detail === 0) stop.pressed();
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape" && !event.repeat) stop.pressed();
});
for (const button of document.querySelectorAll("[data-order]")) {
  button.addEventListener("click", () => press(button.dataset.order, button.textContent));
}
for (const button of document.querySelectorAll("[data-test]")) {
  const order = button.dataset.test;
  button.addEventListener("click", () => press(order, `${TITLES[order].toLowerCase()} begun`));
}
at("record").addEventListener("click", () => (
  condition.recording ? press("end-record", "recording ended") : press("record", "recording begun")
));

const parameters = new Parameters(at("parameters"), at("undo"), (name, value) => link.order("set", { name, value }));

const rig = new RigPanel(at("rig"), (action) => link.order("rig", { action }));
const logs = new Logs(at("logs"), () => link.token);

// Charts

const strips = [
  [new Strip(at("charts"), "pitch", "deg", [["pitch", "blue"], ["set point", "green"]], [-2, 2], 1), (f) => [f.attitude_deg[1], f.set_deg]],
  [new Strip(at("charts"), "pitch rate", "deg/s", [["rate", "teal"]], [-5, 5], 1), (f) => [f.rate_deg_s]],
  [new Strip(at("charts"), "rudder servo", "deg", [["servo", "violet"]], [-5, 5], 1), (f) => [f.servo_deg]],
  [new Strip(at("charts"), "sample to control step", "ms", [["age", "amber"]], [0, 5], 2), (f) => [f.latency_ms]],
  [new Strip(at("charts"), "processor load", "%", [["load", "slate"]], [0, 40], 1), (f) => [f.load_pct]],
];

for (const deg of [-30, -15, 0, 15, 30]) {
  const mark = document.createElementNS("http://www.w3.org/2000/svg", "path");
  mark.setAttribute("d", "M0 -170V-163");
  mark.setAttribute("class", "mark");
  mark.setAttribute("transform", `rotate(${deg})`);
  at("marks").append(mark);
}

/** Shows the newest frame. Seen from the drone's right side its nose is to the right: up is anticlockwise. */
function paint(now) {
  requestAnimationFrame(paint);
  const silent = performance.now() - heard > SILENCE;
  document.body.classList.toggle("stale", silent || !condition.connected);
  if (silent) showSilence();
  if (!frame || now - drawn < DRAW) return;
  drawn = now;
  const [roll, pitch, yaw] = frame.attitude_deg;
  // What is no finite number comes as null.
  document.body.classList.toggle("invalid", pitch === null);
  at("body").setAttribute("transform", `rotate(${-(pitch ?? 0)})`);
  at("setpoint").setAttribute("transform", `rotate(${-(frame.set_deg ?? 0)})`);
  at("rudder").setAttribute("transform", `rotate(${-(frame.servo_deg ?? 0)})`);
  for (const [id, value] of [["pitch", pitch], ["roll", roll], ["yaw", yaw], ["servo", frame.servo_deg]]) {
    at(id).textContent = value === null ? "invalid" : value.toFixed(1);
  }
  for (const [strip] of strips) strip.draw();
}
requestAnimationFrame(paint);

// Conditions

function figures(list, rows) {
  list.replaceChildren(...rows.map(([name, value]) => {
    const [row, dt, dd] = ["div", "dt", "dd"].map((tag) => document.createElement(tag));
    dt.textContent = name;
    dd.textContent = value;
    row.append(dt, dd);
    return row;
  }));
}

/** Nothing is known while the program is silent; what it says then is shown as ever. */
function showSilence() {
  at("problem").textContent = link.refusal || "tvc web does not answer: is it still running? This page tries again by itself.";
  at("state").textContent = "unknown";
  at("state").className = "pill";
  for (const button of document.querySelectorAll("[data-order], [data-test], #record")) button.disabled = true;
}

function showCondition(now) {
  if (condition.recording !== now.recording) logs.list();
  condition = now;
  at("state").textContent = now.state;
  at("state").className = `pill ${now.state.split(" ")[0]}`;
  at("reason").textContent = now.reason === now.state ? "" : now.reason;
  at("port").textContent = now.port;
  at("problem").textContent = now.connected ? "" : `${now.problem} — the page goes on by itself when it is back.`;
  const busy = trial.running;
  const blocked = now.in_operation || busy;
  for (const button of document.querySelectorAll("[data-order], [data-test]")) button.disabled = !now.connected;
  document.querySelector("[data-order=arm]").disabled ||= blocked;
  document.querySelector("[data-order=release]").disabled ||= !now.can_release || busy;
  document.querySelector("[data-order=calibrate]").disabled ||= blocked;
  for (const button of document.querySelectorAll("[data-test]")) button.disabled ||= blocked || now.recording !== null;
  // A recording can be ended though the vehicle is silent.
  at("record").disabled = busy || (!now.connected && now.recording === null);
  at("record").textContent = now.recording && !busy ? "End recording" : "Record";
  at("record").classList.toggle("on", now.recording !== null);
  at("recording").textContent = now.recording_failure ?? (now.recording ? `recording to ${now.recording}` : "");
  at("recording").classList.toggle("bad", now.recording_failure !== null);
  parameters.control(now.armed && !now.can_release);
  at("health").textContent = !now.connected ? "unknown"
    : now.unhealthy.length ? `not healthy: ${now.unhealthy.join(", ")}` : "everything enabled is healthy";
  const count = (value) => value.toLocaleString("en");
  figures(at("link"), [
    ["attitudes", `${now.attitude_hz.toFixed(1)} /s`],
    ["round trip", now.round_trip_ms === null ? "–" : `${now.round_trip_ms.toFixed(1)} ms`],
    ["messages", count(now.messages)],
    ["lost", count(now.lost)],
    ["damaged", count(now.crc_errors)],
    ["dropped aboard", count(now.dropped)],
    ["samples missed", count(now.missed)],
    ["bus errors", count(now.bus_errors)],
  ]);
}

/** A trace stays until the next test, whatever becomes of the window. */
function drawResult() {
  if (!at("trace").hidden) drawTrace(at("trace"), trial.result.trace, ["blue", "violet"]);
}
addEventListener("resize", drawResult);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawResult);

function showTrial(now) {
  trial = now;
  at("trial").hidden = !now.running && !now.stage && !now.result;
  const result = now.result;
  const met = result && result.missed.length === 0;
  at("stage").textContent = now.running ? now.stage || "begins" : result ? (met ? "every requirement met" : "") : now.stage;
  at("tested").textContent = TITLES[now.manoeuvre] ?? "";
  at("tested-log").replaceChildren(...(now.running || !now.log ? [] : [`${now.log} `, logs.links(nameOf(now.log))]));
  at("stage").classList.toggle("met", Boolean(met));
  const traced = result && result.trace.length > 1;
  at("trace").hidden = !traced;
  at("legend").hidden = !traced;
  figures(at("figures"), result ? rowsOf(result) : []);
  at("missed").replaceChildren(...(result?.missed ?? []).map((line) => {
    const item = document.createElement("li");
    item.textContent = line;
    return item;
  }));
  drawResult();
  if (condition.state) showCondition(condition);
}

function showText(text) {
  const list = at("texts");
  const [item, time, words] = ["li", "time", "span"].map((tag) => document.createElement(tag));
  time.textContent = `${text.time_s.toFixed(2)} s`;
  words.textContent = text.text;
  words.className = text.severity <= 3 ? "bad" : text.severity === 4 ? "warning" : "";
  item.append(time, words);
  list.prepend(item);
  while (list.childElementCount > TEXTS) list.lastElementChild.remove();
}

// What comes

function show(news) {
  heard = performance.now();
  if (news.condition) showCondition(news.condition);
  if (news.trial) showTrial(news.trial);
  if ("rig" in news) rig.show(news.rig);
  if (news.parameters) parameters.show(news.parameters);
  for (const text of news.texts ?? []) showText(text);
  const before = frame?.count;
  frame = news.frame;
  shown += 1;
  document.body.dataset.frames = String(shown);
  if (frame.count === before) return;
  for (const [strip, values] of strips) strip.push(frame.time_s, values(frame));
}
