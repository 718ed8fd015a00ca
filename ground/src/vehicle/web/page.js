// The page of `tvc web`: what comes from the program is shown, what is pressed is sent.

import { Attitude } from "./attitude.js";
import { Charts } from "./charts.js";
import { make } from "./dom.js";
import { Guided } from "./guided.js";
import { Link, forPage } from "./link.js";
import { Logs, nameOf } from "./logs.js";
import { ParameterFile } from "./parameter_file.js";
import { Parameters } from "./parameters.js";
import { Releases } from "./releases.js";
import { RigPanel } from "./rig.js";
import { foldable } from "./sections.js";
import { Stop } from "./stop.js";
import { TITLES, rowsOf } from "./tests.js";

const at = (id) => document.getElementById(id);
/** Most messages in the list. */
const TEXTS = 100;
/** Least time between two pictures, ms. */
const DRAW = 35;
/** Between two changes of the figures under the picture, ms. */
const FIGURES = 120;
/** Silence of the program after which the page says so, ms. */
const SILENCE = 1500;
/** Between two checks whether it is silent, ms. */
const LOOK = 250;

let frame = null;
let shown = 0;
let condition = {};
let trial = {};
let heard = performance.now();
let drawn = 0;
let figured = 0;
/** The program has said nothing for a while. */
let silent = false;
/** A picture has been asked for. */
let asked = false;

// The token stands in the address behind #, where no request carries it.
const token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";
addEventListener("hashchange", () => location.reload());
// A page that is connected anew is told every text again.
const link = new Link(token, () => at("texts").replaceChildren(), show);

// Orders

const stop = new Stop(() => link.order("stop"), (words, kind) => {
  // A screen reader reads the text aloud whenever it is set, even to the same words.
  if (at("stopped").textContent !== words) at("stopped").textContent = words;
  at("stopped").className = kind;
});

/** Sends a button's order and tells how it went; without words only that it failed. */
async function press(order, words, fields) {
  const { error } = await link.order(order, fields);
  if (error === undefined && words === "") return;
  const answer = at("answer");
  answer.textContent = error === undefined ? `${words}: done` : forPage(error);
  answer.classList.toggle("done", error === undefined);
  clearTimeout(press.timer);
  press.timer = setTimeout(() => { answer.textContent = ""; }, error ? 8000 : 2000);
}

at("stop").addEventListener("pointerdown", () => stop.pressed());
at("stop").addEventListener("click", (event) => {
  // A click by keyboard: one with the pointer has sent STOP when the button went down.
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

const parameters = new Parameters({
  table: at("parameters"), undo: at("undo"), search: at("search"), only: at("only_changed"), count: at("parameter_count"),
  save: document.querySelector("[data-order=save]"),
}, (name, value) => link.order("set", { name, value }));
const files = { write: at("write_file"), read: at("read_file"), input: at("file"), place: at("file_changes") };
new ParameterFile(files, (order, fields) => link.order(order, fields), parameters);

const guided = new Guided(at("set-up"), press);
const rig = new RigPanel(at("rig"), (action) => link.order("rig", { action }));
const logs = new Logs(at("logs"), () => link.token);

// Pictures

const chartTools = Object.fromEntries(["pause", "earlier", "later", "closer", "farther"].map((name) => [name, document.querySelector(`[data-chart=${name}]`)]));
chartTools.settling = at("settling");
const charts = new Charts(at("strips"), [
  {
    title: "pitch", unit: "deg", least: [-2, 2], decimals: 1, height: 150,
    lines: [["pitch", "blue", (f) => f.attitude_deg[1]], ["set point", "green", (f) => f.set_deg]],
  },
  { title: "pitch rate", unit: "deg/s", least: [-5, 5], decimals: 1, height: 105, lines: [["rate", "teal", (f) => f.rate_deg_s]] },
  { title: "rudder servo", unit: "deg", least: [-5, 5], decimals: 1, height: 105, lines: [["servo", "violet", (f) => f.servo_deg]] },
  {
    title: "roll", unit: "deg", least: [-2, 2], decimals: 1, height: 150, when: (f) => f.roll,
    lines: [["roll", "blue", (f) => f.attitude_deg[0]], ["set point", "green", (f) => f.roll?.set_deg]],
  },
  { title: "roll rate", unit: "deg/s", least: [-5, 5], decimals: 1, height: 105, when: (f) => f.roll, lines: [["rate", "teal", (f) => f.roll?.rate_deg_s]] },
  { title: "second servo", unit: "deg", least: [-5, 5], decimals: 1, height: 105, when: (f) => f.roll, lines: [["servo", "violet", (f) => f.roll?.servo_deg]] },
  { title: "sample to control step", unit: "ms", least: [0, 5], decimals: 2, height: 85, slow: true, lines: [["age", "amber", (f) => f.latency_ms]] },
  { title: "processor load", unit: "%", least: [0, 40], decimals: 1, height: 85, slow: true, lines: [["load", "slate", (f) => f.load_pct]] },
], chartTools);
const releases = new Releases(at("releases"), at("release_charts"), at("release_table"), at("release_unit"));
const attitude = new Attitude(at("attitude"));

for (const deg of [-30, -15, 0, 15, 30]) {
  const mark = document.createElementNS("http://www.w3.org/2000/svg", "path");
  mark.setAttribute("d", "M0 -170V-163");
  mark.setAttribute("class", "mark");
  mark.setAttribute("transform", `rotate(${deg})`);
  at("marks").append(mark);
}

foldable(document.querySelectorAll("main > section"), ["charts"]);

/** Writes a text only if it has changed: the browser lays the page out anew for each write. */
function put(id, words) {
  if (at(id).textContent !== words) at(id).textContent = words;
}

const turned = new Map();

/** Turns a part of the picture, if it is to be seen. Seen from the drone's right side its nose is to the right: up is anticlockwise. */
function turn(id, deg) {
  const words = `rotate(${(-(deg ?? 0)).toFixed(1)})`;
  if (turned.get(id) !== words) at(id).setAttribute("transform", words);
  turned.set(id, words);
}

/** Shows the newest frame. */
function paint(now) {
  asked = false;
  if (!frame) return;
  drawn = performance.now();
  const [roll, pitch, yaw] = frame.attitude_deg;
  // What is no finite number comes as null.
  document.body.classList.toggle("invalid", pitch === null);
  turn("body", pitch);
  turn("setpoint", frame.set_deg);
  turn("rudder", frame.servo_deg);
  attitude.draw(frame.attitude_deg, [frame.servo_deg, frame.roll?.servo_deg ?? null]);
  charts.draw(now);
  if (now - figured < FIGURES) return;
  figured = now;
  for (const [id, value] of [["pitch", pitch], ["roll", roll], ["yaw", yaw], ["servo", frame.servo_deg]]) {
    put(id, value === null ? "invalid" : value.toFixed(1).replace(/^-(0\.0)$/, "$1"));
  }
  // What not every vehicle tells.
  for (const [id, value] of [["second", frame.roll?.servo_deg], ["tilt_sd", frame.tilt_sd_deg], ["heading_sd", frame.heading_sd_deg]]) {
    const told = value !== undefined && value !== null;
    at(`${id}_row`).hidden = !told;
    if (told) put(id, value.toFixed(1).replace(/^-(0\.0)$/, "$1"));
  }
}

setInterval(() => {
  silent = performance.now() - heard > SILENCE;
  document.body.classList.toggle("stale", silent || !condition.connected);
  if (silent) showSilence();
  // No frame asks for a picture now, but charts can be zoomed and the window can change.
  if (silent || !condition.connected) paint(performance.now());
}, LOOK);

// Conditions

function figures(list, rows) {
  list.replaceChildren(...rows.map(([name, value]) =>
    make("div", {}, make("dt", { textContent: name }), make("dd", { textContent: value }))));
}

/** Nothing is known while the program is silent. */
function showSilence() {
  at("problem").textContent = link.refusal || "tvc web does not answer: is it still running? This page tries again by itself.";
  at("state").textContent = "unknown";
  at("state").className = "pill";
  for (const button of document.querySelectorAll("[data-order], [data-test], #record")) button.disabled = true;
  guided.silence(true);
}

/** The program is heard again. What has not changed in between does not come again on the same connection. */
function endSilence() {
  silent = false;
  guided.silence(false);
  if (condition.state) showCondition(condition);
}

function showCondition(now) {
  if (condition.recording !== now.recording) logs.list();
  condition = now;
  at("state").textContent = now.state;
  at("state").className = `pill ${now.state.split(" ")[0]}`;
  at("reason").textContent = now.reason === now.state ? "" : now.reason;
  at("port").textContent = now.port;
  at("problem").textContent = now.connected ? "" : `${now.problem} — the page goes on by itself when it is back.`;
  const busy = trial.running || guided.running;
  const blocked = now.in_operation || busy;
  for (const button of document.querySelectorAll("[data-order], [data-test]")) button.disabled = !now.connected;
  document.querySelector("[data-order=arm]").disabled ||= blocked;
  document.querySelector("[data-order=release]").disabled ||= !now.can_release || busy;
  document.querySelector("[data-order=calibrate]").disabled ||= blocked;
  // The vehicle refuses these while it is armed, the program during a step of the set-up.
  for (const order of ["save", "reload", "reset"]) document.querySelector(`[data-order=${order}]`).disabled ||= now.armed || guided.running;
  for (const button of document.querySelectorAll("[data-test]")) button.disabled ||= blocked || now.recording !== null;
  // A recording can be ended though the vehicle is silent.
  at("record").disabled = busy || (!now.connected && now.recording === null);
  at("record").textContent = now.recording && !busy ? "End recording" : "Record";
  at("record").classList.toggle("on", now.recording !== null);
  at("recording").textContent = now.recording_failure ?? (now.recording ? `recording to ${now.recording}` : "");
  at("recording").classList.toggle("bad", now.recording_failure !== null);
  guided.control(now.connected && !blocked && now.recording === null);
  put("arming", !now.connected || now.in_operation || busy ? "" : now.can_arm ? "Ready to be armed." : now.refusal ? `Cannot be armed: ${forPage(now.refusal)}` : "");
  at("arming").classList.toggle("ready", now.can_arm);
  parameters.control(now.armed && !now.can_release);
  at("health").textContent = !now.connected ? "unknown"
    : now.unhealthy.length ? `not healthy: ${now.unhealthy.join(", ")}` : "everything enabled is healthy";
  const count = (value) => value?.toLocaleString("en") ?? "–";
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

function showTrial(now) {
  trial = now;
  at("trial").hidden = !now.running && !now.stage && !now.result;
  const result = now.result;
  const met = result && result.missed.length === 0;
  at("stage").textContent = now.running ? now.stage || "begins" : result ? (met ? "every requirement met" : "") : forPage(now.stage);
  at("tested").textContent = TITLES[now.manoeuvre] ?? "";
  at("tested-log").replaceChildren(...(now.running || !now.log ? [] : [`${now.log} `, logs.links(nameOf(now.log))]));
  at("stage").classList.toggle("met", Boolean(met));
  figures(at("figures"), result ? rowsOf(result) : []);
  at("missed").replaceChildren(...(result?.missed ?? []).map((line) => make("li", { textContent: line })));
  if (condition.state) showCondition(condition);
}

function showText(text) {
  const list = at("texts");
  const time = make("time", { textContent: `${text.time_s.toFixed(2)} s` });
  const className = text.severity <= 3 ? "bad" : text.severity === 4 ? "warning" : "";
  list.prepend(make("li", {}, time, make("span", { textContent: forPage(text.text), className })));
  while (list.childElementCount > TEXTS) list.lastElementChild.remove();
}

// What comes

function show(news) {
  heard = performance.now();
  if (silent) endSilence();
  if (news.condition) showCondition(news.condition);
  if (news.trial) showTrial(news.trial);
  if ("rig" in news) rig.show(news.rig);
  if (news.set_up) {
    guided.show(news.set_up);
    if (condition.state) showCondition(condition);
  }
  if (news.releases) releases.show(news.releases);
  if (news.parameters) {
    parameters.show(news.parameters);
    guided.tell(news.parameters);
  }
  for (const text of news.texts ?? []) showText(text);
  const before = frame?.count;
  frame = news.frame;
  shown += 1;
  document.body.dataset.frames = String(shown);
  if (frame.count === before) return;
  charts.push(frame.time_s, frame);
  if (asked || performance.now() - drawn < DRAW) return;
  asked = true;
  requestAnimationFrame(paint);
}
