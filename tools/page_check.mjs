// The scripts of the page of `tvc web` without a browser: what keys do, and which buttons can be pressed when.
//
//     node --test tools/page_check.mjs
//
// Needs Node 20 and nothing else; `browser_stub.mjs` stands in for the browser. `tools/web_check.py` tries the whole page
// in Chromium.

import assert from "node:assert/strict";
import { before, beforeEach, mock, test } from "node:test";

import { Element, Plot, at, draw, ends, openPage, order, page, requests, script, sent, socket, tests } from "./browser_stub.mjs";

const row = {
  name: "PID_KP", value: 1, default: 1, unit: "", range: "0 to 10", meaning: "gain", between: [0, 10], choices: null, live: true,
  measured: false, group: "Control law", stored: 1,
};
const other = { ...row, name: "SRV_DIR", meaning: "direction", group: "Servo", range: "-1, 1", between: null, choices: [-1, 1] };
const vehicle = {
  port: "nano", connected: true, problem: "", state: "standby", reason: "", armed: false, in_operation: false,
  can_release: false, can_arm: true, refusal: "", unhealthy: [], attitude_hz: 300, messages: 1, lost: 0, crc_errors: 0,
  // Not told yet.
  dropped: null, missed: null, bus_errors: null, round_trip_ms: null, recording: null, recording_failure: null,
};
const frame = {
  time_s: 1, count: 1, attitude_deg: [0, 17, 0], rate_deg_s: 0, servo_deg: 0, pulse_us: 1500, set_deg: 0, latency_ms: 4, load_pct: 20,
};
/** Something comes from the program. */
const come = (news) => socket.fire("message", { data: JSON.stringify(news) });
const show = (status) => come({ now_ms: 7000, frame, condition: { ...vehicle, ...status } });
/** Lets everything happen that waits for nothing but its turn. */
const settle = () => new Promise((done) => { setImmediate(done); });
/** The newest order of this name is answered. */
const answer = async (order, answer) => {
  await come({ id: sent.findLast((message) => message.order === order).id, ...answer });
  await settle();
};
const orderNames = () => sent.map((message) => message.order);
/** The table's rows below the heading of a group. */
const rows = (group) => at("parameters").children[group].children.slice(1);
const field = () => rows(0)[0].children[1].children[0];
const said = () => rows(0)[0].children[1].children[1];
const escape = (where) => where.fire("keydown", { key: "Escape" });

before(async () => {
  mock.timers.enable({ apis: ["setInterval", "setTimeout"] });
  await openPage();
  await socket.fire("open");
  await come({ now_ms: 5000, frame, parameters: [row, other] });
  await show({});
});

beforeEach(async () => {
  for (const end of ends.splice(0)) end(new Error("the test is over"));
  await settle();
  sent.length = 0;
  requests.length = 0;
  field().left = false;
  await show({});
});

test("the page begins with the token of its address, and an order carries the newest time", async () => {
  assert.equal(socket.tag, "ws://127.0.0.1:8650/page");
  await come({ now_ms: 8125, frame });
  order("arm").fire("click");
  assert.deepEqual(sent.map((message) => [message.order, message.heard_ms]), [["arm", 8125]]);
  await answer("arm", { error: "arm refused" });
  assert.equal(at("answer").textContent, "arm refused");
});

test("a word that is good once gives way to the token", async () => {
  let address = "";
  globalThis.history = { replaceState(state, title, url) { address = url; } };
  await come({ token: "lasting" });
  assert.equal(address, "#token=lasting");
  sent.length = 0;
  await socket.fire("open");
  assert.deepEqual(sent, [{ token: "lasting" }]);
});

test("Escape leaves an edited field, and is STOP anywhere else", async () => {
  assert.equal(field().value, "1");
  field().value = "1.25";
  await escape(field());
  assert.equal(field().value, "1", "what the vehicle has");
  assert.equal(field().left, true);
  assert.deepEqual([sent, requests], [[], []]);
  await escape(page);
  assert.deepEqual(orderNames(), ["stop"]);
  assert.deepEqual(requests, [["/stop", { "X-Stop": "1" }]]);
  await answer("stop", {});
  assert.match(at("stopped").textContent, /answered/);
});

test("a STOP is repeated, and the page says that it is not answered, until it is", async () => {
  await escape(page);
  mock.timers.tick(300);
  assert.match(at("stopped").textContent, /NOT ANSWERED.*cut the vehicle's power/);
  assert.equal(at("stopped").className, "bad");
  mock.timers.tick(1000);
  assert.ok(orderNames().length >= 4, `${sent.length} copies in 1.3 s`);
  await answer("stop", { error: "the port went away" });
  mock.timers.tick(300);
  assert.match(at("stopped").textContent, /NOT ANSWERED \(the port went away\)/);
  await answer("stop", { note: "the rudder is at neutral; the fault stays" });
  assert.match(at("stopped").textContent, /is answered: .*the fault stays/);
  assert.equal(at("stopped").className, "done");
  const count = sent.length;
  mock.timers.tick(1000);
  assert.equal(sent.length, count, "no repeats after the answer");
  // An answer to an earlier press says nothing about the next one.
  const [{ id }] = sent;
  await escape(page);
  await come({ id });
  await settle();
  mock.timers.tick(300);
  assert.match(at("stopped").textContent, /NOT ANSWERED/);
  await answer("stop", {});
});

test("each press of STOP has its own time to be answered in", async () => {
  await escape(page);
  mock.timers.tick(200);
  await answer("stop", {});
  await escape(page);
  mock.timers.tick(100);
  assert.doesNotMatch(at("stopped").textContent, /NOT ANSWERED/);
  mock.timers.tick(150);
  assert.match(at("stopped").textContent, /NOT ANSWERED/);
  await answer("stop", {});
});

test("a STOP without a connection is said to be unanswered, and goes by HTTP", async () => {
  const lost = socket;
  await lost.fire("close", { code: 4403 });
  await escape(page);
  mock.timers.tick(300);
  assert.match(at("stopped").textContent, /NOT ANSWERED/);
  assert.ok(requests.length >= 1);
  mock.timers.tick(500);
  assert.notEqual(socket, lost, "it connects again");
  await socket.fire("open");
  await show({});
  mock.timers.tick(250);
  await answer("stop", {});
  assert.match(at("stopped").textContent, /is answered/);
});

test("what is out of range is not sent, and a change in control is asked for once", async () => {
  const change = async (value) => {
    field().value = value;
    field().fire("change");
    await settle();
  };
  await change("11");
  assert.equal(said().textContent, "PID_KP must be 0 to 10");
  assert.deepEqual([field().value, sent], ["1", []]);
  assert.equal(field().step, "0.01", "a thousandth of the range");
  await show({ state: "active", armed: true, in_operation: true });
  await change("1.01");
  assert.deepEqual(sent, []);
  await said().children[0].fire("click");
  assert.deepEqual([sent[0].name, sent[0].value], ["PID_KP", 1.01]);
  await answer("set", {});
  await come({ now_ms: 7001, frame, parameters: [{ ...row, value: 1.01 }] });
  await change("1.02");
  assert.equal(sent.length, 2, "agreed to until the vehicle is disarmed");
  await answer("set", {});
  await come({ now_ms: 7002, frame, parameters: [{ ...row, value: 1.02 }] });
  assert.equal(at("undo").textContent, "Undo PID_KP: back to 1.01");
  at("undo").fire("click");
  assert.equal(sent[2].value, 1.01);
  await answer("set", {});
  await come({ now_ms: 7003, frame, parameters: [row] });
  await show({});
  await show({ state: "active", armed: true, in_operation: true });
  await change("1.01");
  assert.equal(sent.length, 3, "asked for again");
});

test("a change that nobody has agreed to is gone when the control ends", async () => {
  await show({ state: "active", armed: true, in_operation: true });
  field().value = "1.5";
  await field().fire("change");
  assert.equal(said().children.length, 1);
  await show({});
  assert.deepEqual([field().value, said().children.length, sent], ["1", 0, []]);
});

test("an attitude that is no number is shown as invalid, and drawing goes on", async () => {
  await come({ now_ms: 7004, frame: { ...frame, count: 2, attitude_deg: [null, null, null], rate_deg_s: null } });
  draw(1000);
  assert.equal(at("pitch").textContent, "invalid");
  await come({ now_ms: 7005, frame: { ...frame, count: 3 } });
  draw(2000);
  assert.equal(at("pitch").textContent, "17.0");
});

test("a recording can be ended while the vehicle is silent", async () => {
  await show({ connected: false, recording: "flight-001.tlog" });
  assert.equal(at("record").disabled, false);
  assert.equal(order("arm").disabled, true);
  await show({ connected: false });
  assert.equal(at("record").disabled, true);
  await show({});
  assert.equal(at("record").disabled, false);
  await show({ recording_failure: "the recording ended: no space" });
  assert.equal(at("recording").textContent, "the recording ended: no space");
});

test("a test's figures are shown, and its log can be opened", async () => {
  tests[1].fire("click");
  assert.deepEqual(orderNames(), ["hold"]);
  await answer("hold", {});
  const result = {
    run: null, hold: { mean_error_rad: 0.001, rms_error_rad: 0.002, max_error_rad: 0.0175 }, sweep: { bandwidth_hz: null, delay_s: 0.05 },
    loop: { jitter_us_max: 3 }, telemetry: { lost: 0 }, missed: [],
  };
  const trial = { manoeuvre: "hold", running: false, stage: "", log: "small/hold-001.tlog", result };
  await come({ now_ms: 7006, frame, trial });
  assert.equal(at("tested").textContent, "Hold test");
  assert.equal(at("stage").textContent, "every requirement met");
  const rows = at("figures").children.map((row) => row.children.map((cell) => cell.textContent));
  assert.deepEqual(rows.slice(2, 5), [["worst", "1.00 deg"], ["bandwidth", "above 4 Hz"], ["delay", "50 ms"]]);
  const [report] = at("tested-log").children[1].children;
  report.fire("click");
  assert.deepEqual(requests, [["reports/hold-001.tlog", { Authorization: "Bearer lasting" }]]);
});

test("the panel of the rig is there for a rig only, and its buttons are actions", async () => {
  await come({ now_ms: 7007, frame, rig: null });
  assert.equal(at("rig").hidden, true);
  const rig = {
    time_s: 1, pitch_rad: 0.4, held: true, clamp: "auto", start_rad: 0.4, faults: ["frozen"], disturbances: [], usb: true, bootloader: false, resets: 0,
  };
  await come({ now_ms: 7008, frame, rig });
  assert.equal(at("rig").hidden, false);
  assert.deepEqual(requests, [["rig.json", undefined]]);
  const all = (from) => [from, ...from.children.filter((child) => child instanceof Element).flatMap(all)];
  const button = (words) => all(at("rig")).find((child) => child.tag === "button" && child.textContent === words);
  button("frozen ×").fire("click");
  button("Power cycle").fire("click");
  button("Tilt").fire("click");
  assert.deepEqual(sent.map(({ action }) => action), ["clear frozen", "power-cycle", "tilt 0.4014"]);
  for (const { id } of [...sent]) await come({ id });
});

test("arming and release wait for their states", async () => {
  const disabled = () => ["arm", "release", "calibrate"].map((name) => order(name).disabled);
  await show({});
  assert.deepEqual(disabled(), [false, true, false]);
  await show({ state: "armed", armed: true, in_operation: true, can_release: true });
  assert.deepEqual(disabled(), [true, false, true]);
  await show({ state: "failsafe", in_operation: true });
  assert.deepEqual(disabled(), [true, true, true]);
});

/** A part of the set-up. */
const guide = (name) => at("set-up").querySelector(`.${name}`);
const setUp = {
  running: true, step: "servo", instruction: "", lines: [], share: null, progress: "", seen: null, figures: [], met: false,
  ending: "", question: null,
};
const ask = (id, again) => come({ now_ms: 7000, frame, set_up: {
  ...setUp, question: { id, words: "Centre", buttons: [["+ 5", "+"], ["It is so", ""]], entry: "us", again },
} });
/** Lets the time pass in which a new question takes no answer. */
const wait = async () => {
  const later = performance.now() + 450;
  while (performance.now() < later) await settle();
};
const endSetUp = () => come({ now_ms: 7000, frame, set_up: { ...setUp, running: false, ending: "the vehicle is as it was" } });
const replies = () => sent.filter(({ order }) => order === "answer").map(({ question, reply }) => [question, reply]);

test("an answer is for the question in sight, and a click that was meant for another counts for none", async () => {
  await ask(7, false);
  guide("replies").children[0].fire("click");
  assert.deepEqual(replies(), []);
  await wait();
  guide("replies").children[0].fire("click");
  // The same question again is answered as soon as one likes.
  await ask(8, true);
  guide("replies").children[0].fire("click");
  assert.deepEqual(replies(), [[7, "+"], [8, "+"]]);
  await ask(9, false);
  guide("replies").children[1].fire("click");
  assert.deepEqual(replies(), [[7, "+"], [8, "+"]]);
  // Nothing else can be begun meanwhile.
  assert.deepEqual([order("arm").disabled, tests[0].disabled, at("record").disabled], [true, true, true]);
  await endSetUp();
  assert.deepEqual([order("arm").disabled, tests[0].disabled, at("record").disabled], [false, false, false]);
});

test("what is typed is kept until it is sent, and is not for the next question", async () => {
  await ask(20, false);
  guide("typed").value = "1523";
  await guide("entry").fire("submit");
  assert.deepEqual([replies(), guide("typed").value], [[], "1523"]);
  await ask(21, true);
  assert.equal(guide("typed").value, "1523");
  await ask(22, false);
  assert.equal(guide("typed").value, "");
  await wait();
  guide("typed").value = "1500";
  await guide("entry").fire("submit");
  assert.deepEqual([replies(), guide("typed").value], [[[22, "1500"]], ""]);
  await endSetUp();
});

test("after a silence of the program the page shows again what it knows", async () => {
  await ask(30, false);
  const buttons = () => [guide("replies").children[0].disabled, order("calibrate").disabled];
  const now = performance.now();
  const clock = mock.method(performance, "now", () => now + 1600);
  mock.timers.tick(250);
  assert.match(at("problem").textContent, /does not answer/);
  assert.deepEqual([at("state").textContent, ...buttons()], ["unknown", true, true]);
  // Nothing has changed meanwhile.
  await come({ now_ms: 7000, frame });
  clock.mock.restore();
  assert.deepEqual([at("problem").textContent, at("state").textContent], ["", "standby"]);
  assert.deepEqual(buttons(), [false, true]);
  await endSetUp();
  assert.deepEqual(buttons(), [false, false]);
});

test("what is stored cannot be touched where the vehicle or the program would refuse it", async () => {
  const disabled = () => ["save", "reload", "reset"].map((name) => order(name).disabled);
  assert.deepEqual(disabled(), [false, false, false]);
  await show({ state: "armed", armed: true, in_operation: true, can_release: true });
  assert.deepEqual(disabled(), [true, true, true]);
  await show({ state: "failsafe", in_operation: true });
  assert.deepEqual(disabled(), [false, false, false]);
  await show({});
  await ask(31, false);
  assert.deepEqual(disabled(), [true, true, true]);
  await endSetUp();
  assert.deepEqual(disabled(), [false, false, false]);
});

test("a list of recordings that came is not shown as an error", async () => {
  const [, buttons, told] = at("logs").children;
  const [again] = buttons.children;
  again.fire("click");
  ends.pop()(new Error("no connection"));
  await settle();
  assert.deepEqual([told.textContent, told.className], ["no connection", "bad"]);
  const unanswered = globalThis.fetch;
  globalThis.fetch = async () => ({ ok: true, json: async () => [] });
  again.fire("click");
  await settle();
  globalThis.fetch = unanswered;
  assert.deepEqual([told.textContent, told.className], ["none so far", ""]);
});

test("before Arm is pressed the page says why it would be refused", async () => {
  await show({ can_arm: false, refusal: "gyro offset unknown: hold still" });
  assert.equal(at("arming").textContent, "Cannot be armed: gyro offset unknown: hold still");
  await show({});
  assert.equal(at("arming").textContent, "Ready to be armed.");
  await show({ can_arm: false });
  assert.equal(at("arming").textContent, "", "unknown");
  await show({ state: "armed", in_operation: true, can_arm: false, refusal: "old" });
  assert.equal(at("arming").textContent, "");
});

// Parameters

const groups = () => at("parameters").children.map((group) => [group.children[0].children[0].children[0].textContent, group.children[1]?.hidden]);
const search = async (words, only = false) => {
  at("search").value = words;
  at("only_changed").checked = only;
  await at("search").fire("input");
};

test("parameters stand in groups, of which the first is open, and what is looked for is found in all", async () => {
  await come({ now_ms: 7010, frame, parameters: [row, other] });
  assert.deepEqual(groups(), [["Control law", false], ["Servo", true]]);
  await at("parameters").children[1].children[0].children[0].children[0].fire("click");
  assert.equal(rows(1)[0].hidden, false);
  await at("parameters").children[1].children[0].children[0].children[0].fire("click");
  await search("direc");
  assert.deepEqual([rows(0)[0].hidden, rows(1)[0].hidden], [true, false], "by the meaning, in a closed group");
  assert.equal(at("parameters").children[0].hidden, true);
  await escape(at("search"));
  assert.deepEqual([at("search").value, at("search").left, sent], ["", true, []], "Escape leaves it and is no STOP");
  assert.deepEqual([rows(0)[0].hidden, rows(1)[0].hidden], [false, true]);
});

test("what is changed or not saved is marked, counted and found, and what the vehicle measures is neither", async () => {
  const measured = { ...other, name: "CLK_FINE", measured: true, value: 511, default: -1, stored: null };
  await come({ now_ms: 7011, frame, parameters: [{ ...row, value: 2, stored: 1.5 }, other, measured] });
  const [name, , , range] = rows(0)[0].children;
  assert.deepEqual([name.children[0].textContent, name.children[0].title], ["not saved", "in flash: 1.5"]);
  assert.equal(range.textContent, "0 to 10; default 1");
  assert.equal(at("parameter_count").textContent, "1 changed from the defaults, 1 not saved");
  assert.equal(groups()[0][0], "Control law · 1 changed");
  await search("", true);
  assert.deepEqual([rows(0)[0].hidden, rows(1)[0].hidden, rows(1)[1].hidden], [false, true, true]);
  await search("");
  await come({ now_ms: 7012, frame, parameters: [row, other, measured] });
  assert.equal(name.children[0].textContent, "");
  await come({ now_ms: 7013, frame, parameters: [{ ...row, stored: null }, other, measured] });
  assert.equal(name.children[0].textContent, "", "unknown");
  await come({ now_ms: 7014, frame, parameters: [row, other, measured] });
});

test("what another firmware does not have goes out of the table", async () => {
  const servos = at("parameters").children[1];
  await come({ now_ms: 7015, frame, parameters: [] });
  assert.equal(rows(1).length, 2, "not known yet");
  await come({ now_ms: 7016, frame, parameters: [row] });
  assert.deepEqual([rows(1).length, servos.hidden], [0, true]);
  await come({ now_ms: 7017, frame, parameters: [row, other] });
  assert.deepEqual([rows(1).length, servos.hidden], [1, false]);
});

test("commands of the tool are said as the page's buttons", async () => {
  await show({ can_arm: false, refusal: "run tvc calibrate polarity first" });
  assert.equal(at("arming").textContent, "Cannot be armed: press Check polarity first");
  await come({ now_ms: 7000, frame, texts: [{ id: 900, time_s: 1, severity: 4, text: "arm refused: run tvc calibrate polarity first" }] });
  assert.equal(at("texts").children.at(-1).children[1].textContent, "arm refused: press Check polarity first");
});

test("a gain that another control law does not use goes to a closed group", async () => {
  const unused = { ...row, group: "Not used by law 0" };
  await come({ now_ms: 7018, frame, parameters: [unused, other] });
  assert.deepEqual(groups().slice(-1), [["Not used by law 0", true]]);
  const last = groups().length - 1;
  assert.deepEqual([rows(0).length, rows(last).length, rows(last)[0].hidden], [0, 1, true]);
  assert.equal(at("parameters").children[0].hidden, true, "nothing is left in it");
  await come({ now_ms: 7019, frame, parameters: [row, other] });
  assert.deepEqual([rows(0).length, rows(last).length], [1, 0]);
});

const choose = async (text) => {
  at("file").chosen = [{ name: "mine.parm", text: async () => text }];
  await at("file").fire("change");
  await settle();
};
const told = () => at("file_changes").children.map((part) => part.textContent);

test("a parameter file is set only when somebody agrees, and not in control", async () => {
  await choose("PID_KP 2");
  assert.deepEqual([sent[0].order, sent[0].text], ["read-file", "PID_KP 2"]);
  await answer("read-file", { note: "PID_KP           2\nSRV_DIR          1\nNO_SUCH          3\n" });
  assert.deepEqual(at("file_changes").children[1].children.map((item) => item.textContent), ["PID_KP: 1 → 2"]);
  assert.match(told().join(), /no parameter NO_SUCH/);
  await choose("SRV_POLARITY 1");
  await answer("read-file", { note: "# polarity is not taken from a file\n" });
  assert.deepEqual(told(), ["mine.parm: the vehicle has all of its 0 values.", "polarity is not taken from a file"]);
  sent.length = 0;
  await choose("PID_KP 2");
  await answer("read-file", { note: "PID_KP           2\n" });
  assert.equal(sent.length, 1, "nothing is set yet");
  const [agree, cancel] = at("file_changes").children.at(-1).children;
  await show({ state: "active", armed: true, in_operation: true });
  await agree.fire("click");
  assert.deepEqual([sent.length, told()], [1, ["The vehicle is in control: disarm first."]]);
  await show({});
  agree.fire("click");
  await settle();
  assert.deepEqual([sent[1].name, sent[1].value], ["PID_KP", 2]);
  await answer("set", { error: "PID_KP stays at 1" });
  assert.deepEqual(told(), ["mine.parm: 0 of 1 set; Save keeps them.", "PID_KP: PID_KP stays at 1"]);
  await cancel.fire("click");
  assert.deepEqual(told(), []);
  await choose("x".repeat(20_000));
  assert.match(told()[0], /too long/);
});

test("a parameter file is measured in bytes, and one that cannot be read is said to be so", async () => {
  await choose("é".repeat(9000));
  assert.deepEqual([sent.length, told()], [0, ["mine.parm: too long for a parameter file"]]);
  at("file").chosen = [{ name: "gone.parm", text: async () => { throw new Error("it was removed"); } }];
  await at("file").fire("change");
  assert.deepEqual(told(), ["gone.parm: it was removed"]);
});

// Pictures

/** Charts of the last minute, of both axes. */
const STRIPS = 8;
const strips = () => Plot.made.slice(0, STRIPS);
const push = async (time_s, more = {}) => {
  frame.count += 1;
  await come({ now_ms: 7100, frame: { ...frame, time_s, ...more } });
};
const press = (name) => at(`[data-chart=${name}]`).fire("click");

test("charts follow the vehicle's time, stay while they are paused, and zoom", async () => {
  for (let time = 100; time <= 130; time += 1) await push(time);
  draw(5000);
  assert.deepEqual(strips()[0].scales.x, { min: 110, max: 130 });
  await press("closer");
  assert.deepEqual(strips()[0].scales.x, { min: 120, max: 130 });
  await press("farther");
  await press("pause");
  const view = { ...strips()[1].scales.x };
  assert.ok(Math.abs(view.max - 130) < 1e-6 && Math.abs(view.min - 110) < 1e-6);
  for (let time = 131; time <= 140; time += 1) await push(time);
  draw(6000);
  assert.deepEqual(strips()[1].scales.x, view, "paused");
  await press("earlier");
  assert.ok(Math.abs(strips()[0].scales.x.min - 100) < 1e-6);
  // What was dragged over in one of them.
  const [plot] = strips();
  Object.assign(plot, { select: { left: 10, width: 40 }, posToVal: (at) => 110 + at / 10, setSelect() {} });
  plot.options.hooks.setSelect[0](plot);
  draw(7000);
  assert.ok(Math.abs(strips()[2].scales.x.min - 111) < 1e-6 && Math.abs(strips()[2].scales.x.max - 115) < 1e-6);
  await press("pause");
  draw(8000);
  assert.deepEqual(strips()[0].scales.x, { min: 120, max: 140 });
  // Where nothing has come there is no line.
  await push(145);
  draw(8500);
  assert.deepEqual(strips()[0].data[1].slice(-3), [17, null, 17]);
});

test("charts can be zoomed by dragging while the vehicle is silent", async () => {
  await show({ connected: false });
  const [plot] = strips();
  plot.options.hooks.setSelect[0](plot);
  mock.timers.tick(250);
  assert.ok(Math.abs(strips()[2].scales.x.min - 111) < 1e-6 && Math.abs(strips()[2].scales.x.max - 115) < 1e-6);
  await press("pause");
  await show({});
});

test("the cursor tells its time and the values there, and no number is a gap", async () => {
  await push(150, { attitude_deg: [0, null, 0] });
  const [plot] = strips();
  draw(9000);
  assert.equal(plot.data[1].at(-1), null);
  const words = at("strips").children[0].children[0].children.at(-1);
  assert.equal(words.textContent, "invalid deg");
  plot.cursor = { left: 20, idx: plot.data[0].indexOf(140) };
  plot.options.hooks.setCursor[0]();
  assert.equal(words.textContent, "at 140.00 s: 17.0 · 0.0 deg");
  plot.cursor = { left: -10, idx: null };
  plot.options.hooks.setCursor[0]();
});

test("a clock that went back begins the charts anew, and no more than a minute or so is kept", async () => {
  for (let time = 200; time <= 400; time += 1) await push(time);
  const { length } = strips()[0].data[0];
  draw(10_000);
  assert.ok(strips()[0].data[0].length <= 75, `${length}`);
  // What is looked at stays for a while.
  await press("pause");
  for (let time = 401; time <= 800; time += 1) await push(time);
  await press("earlier");
  assert.ok(strips()[0].data[0][0] < 390);
  for (let time = 801; time <= 1500; time += 1) await push(time);
  await press("later");
  assert.ok(strips()[0].data[0].length <= 615, `${strips()[0].data[0].length}`);
  await press("pause");
  await push(5);
  draw(11_000);
  assert.deepEqual(strips()[0].data[0], [5]);
});

test("an invalid attitude is written into the picture in place of the drone", async () => {
  at("attitude").written.length = 0;
  await push(6, { attitude_deg: [0, null, 0] });
  draw(12_000);
  assert.deepEqual(at("attitude").written, ["attitude invalid"]);
  await push(7);
  draw(13_000);
  assert.deepEqual(at("attitude").written.slice(1), ["N", "E", "S", "W"]);
});

test("the picture's body is turned by yaw, pitch and roll in turn, nose up positive", async () => {
  const { rotation, seen } = await script("attitude.js");
  const near = (found, expected) => found.forEach((value, i) => assert.ok(Math.abs(value - expected[i]) < 1e-9, `${found}`));
  near(rotation([0, 90, 0])([1, 0, 0]), [0, 0, -1]);
  near(rotation([0, 0, 90])([1, 0, 0]), [0, 1, 0]);
  near(rotation([90, 0, 0])([0, 1, 0]), [0, 0, 1]);
  near(rotation([0, 90, 90])([0, 0, 1]), [0, 1, 0]);
  // Down is down, and north to the right of south, seen from the east.
  assert.ok(seen([0, 0, 1])[1] > 0.5 && seen([1, 0, 0])[0] > seen([-1, 0, 0])[0]);
});

test("charts and figures of the second axis are there for a vehicle that has one", async () => {
  const hidden = () => at("strips").children.map((figure) => Boolean(figure.hidden));
  const roll = { rate_deg_s: 1, servo_deg: -3, pulse_us: 1470, set_deg: 0 };
  await push(200);
  assert.deepEqual(hidden(), [false, false, false, true, true, true, false, false]);
  assert.ok(at("second_row").hidden && at("tilt_sd_row").hidden);
  await push(201, { roll, tilt_sd_deg: 1.5, heading_sd_deg: 4 });
  draw(20000);
  assert.ok(!hidden().includes(true));
  assert.deepEqual(["second", "tilt_sd", "heading_sd"].map((id) => at(id).textContent), ["-3.0", "1.5", "4.0"]);
  await push(202);
  draw(21000);
  assert.ok(hidden()[3] && at("second_row").hidden);
});

const released = (number, more = {}) => ({
  number, time_s: 10 * number, test: number === 1 ? "hold" : null, log: null, set_deg: 1, start_deg: 20, stayed: true, changes: [],
  run: { rise_s: 0.4, overshoot_pct: 2, settling_5pct_s: null, final_error_rad: 0 },
  trace: [[0, 21, 0], [1, 11, 5], [2, 1, 0]], ...more,
});

test("releases are drawn over each other in percent of their tilt, and their figures stand in a table", async () => {
  at("release_unit").value = "percent";
  const changes = [["PID_KD", 0.435, 0.5]];
  const still = released(3, { start_deg: 0.5, trace: [[0, 1.5, 0], [1, 1, 0]], run: null });
  await come({ now_ms: 7200, frame, releases: [released(1), released(2, { changes, start_deg: 10, trace: [[0, 11, 0], [1, 1, 1]] }), still] });
  const [pitch, servo] = Plot.made.slice(STRIPS);
  assert.deepEqual(pitch.data.slice(1), [[100, 50, 0], [100, 0]], "not the one without a tilt");
  assert.deepEqual(servo.data[1], [0, 5, 0]);
  const lines = at("release_table").children;
  assert.deepEqual(lines.map((line) => line.children.map((cell) => cell.textContent)).slice(0, 2), [
    ["", "0.5", "–", "–", "–", "the set point moved", "–", "–"],
    ["", "10.0", "0.400", "2.0", "never", "0.00", "PID_KD 0.435 → 0.5", "–"],
  ]);
  const name = (line) => line.children[0].children[0].children[2].textContent;
  assert.deepEqual(lines.map(name), [" 3, by hand at 30.0 s", " 2, by hand at 20.0 s", " 1, hold test at 10.0 s"]);
  // The band is drawn from -5 to 5 %.
  const filled = [];
  pitch.options.hooks.drawClear[0]({
    valToPos: (value) => 100 - value, bbox: { left: 0, width: 300 },
    ctx: { save() {}, restore() {}, fillRect(...at) { filled.push(at); } },
  });
  assert.deepEqual(filled, [[0, 95, 300, 10]]);
  // One of them is left out.
  const [box] = lines[1].children[0].children[0].children;
  box.checked = false;
  await box.fire("change");
  assert.deepEqual(Plot.made[STRIPS].data.slice(1), [[100, 50, 0]]);
});

test("sections with a heading open and close, and on a small screen most begin closed", async () => {
  const { foldable } = await script("sections.js");
  const section = (id) => {
    const [made, heading] = [new Element("section"), Object.assign(new Element("h2"), { tagName: "H2" })];
    made.append(heading);
    return Object.assign(made, { id });
  };
  const [charts, gains, plain] = [section("charts"), section("gains"), new Element("section")];
  plain.append(new Element("p"));
  const wide = globalThis.matchMedia;
  globalThis.matchMedia = () => ({ matches: true });
  foldable([charts, gains, plain], ["charts"]);
  globalThis.matchMedia = wide;
  const button = gains.children[0].children[0];
  const closed = () => [charts, gains, plain].map((made) => made.classes.has("closed"));
  assert.deepEqual([closed(), button["aria-expanded"]], [[false, true, false], "false"]);
  await button.fire("click");
  assert.deepEqual([closed(), button["aria-expanded"]], [[false, false, false], "true"]);
});

test("charts are shaded where the estimate begins anew", async () => {
  const anew = (time, settling) => come({ now_ms: 7000, frame: { ...frame, time_s: time, count: time, settling } });
  for (const [time, settling] of [[200, false], [201, true], [202, true], [203, false], [204, false]]) await anew(time, settling);
  assert.equal(at("settling").hidden, false);
  draw(90_000);
  const [plot] = strips();
  const filled = [];
  const ctx = { save() {}, restore() {}, fillRect: (...box) => filled.push(box) };
  Object.assign(plot, { ctx, bbox: { top: 5, height: 50 }, valToPos: (value) => 10 * value });
  plot.options.hooks.drawClear[0](plot);
  assert.deepEqual(filled, [[2010, 5, 20, 50]]);
  await anew(290, false);
  assert.equal(at("settling").hidden, true, "it is out of sight");
});
