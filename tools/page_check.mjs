// The scripts of the page of `tvc web` without a browser: what keys do, and which buttons can be pressed when.
//
//     node --test tools/page_check.mjs
//
// Needs Node 20 and nothing else. `tools/web_check.py` tries the whole page in Chromium.

import assert from "node:assert/strict";
import { cpSync, mkdtempSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { before, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";

/** As much of an element as the scripts use. */
class Element {
  constructor(tag) {
    Object.assign(this, { tag, listeners: {}, children: [], dataset: {}, style: {}, parent: null, value: "", textContent: "" });
    this.classList = { toggle() {} };
    this.disabled = false;
  }
  get disabled() { return this.isDisabled; }
  set disabled(value) { this.isDisabled = Boolean(value); }
  addEventListener(kind, listener) { (this.listeners[kind] ??= []).push(listener); }
  /** An event here and at every element around this one, unless it is stopped. */
  async fire(kind, event = {}) {
    let stopped = false;
    Object.assign(event, { stopPropagation() { stopped = true; }, preventDefault() {} });
    for (let at = this; at && !stopped; at = at.parent) {
      for (const listener of at.listeners[kind] ?? []) await listener(event);
    }
  }
  append(...children) {
    for (const child of children) {
      child.parent = this;
      this.children.push(child);
    }
  }
  prepend(...children) { this.append(...children); }
  replaceChildren(...children) { this.children = []; this.append(...children); }
  add(option) { this.append(option); }
  insertRow() { return this.insert("tr"); }
  insertCell() { return this.insert("td"); }
  insert(tag) {
    const child = new Element(tag);
    this.append(child);
    return child;
  }
  get tBodies() { return [this]; }
  get lastElementChild() { return this.children.at(-1); }
  get childElementCount() { return this.children.length; }
  setAttribute() {}
}

const page = new Element("document");
const elements = {};
const orders = ["arm", "release", "calibrate", "save", "reload", "reset"].map((order) => {
  const button = new Element("button");
  button.dataset.order = order;
  page.append(button);
  return button;
});
/** What was sent to the program. */
const sent = [];
let stream = null;
const row = {
  name: "PID_KP", value: 1, default: 1, unit: "", range: "0 to 10", meaning: "gain", between: [0, 10], choices: null, live: true,
};
const vehicle = {
  port: "nano", connected: true, problem: "", state: "standby", reason: "", armed: false, in_operation: false,
  can_release: false, unhealthy: [], attitude_hz: 300, messages: 1, lost: 0, crc_errors: 0, dropped: 0, missed: 0,
  bus_errors: 0, round_trip_ms: null, recording: null, parameters: 1,
};
const at = (id) => {
  if (!elements[id]) page.append(elements[id] = new Element(id));
  return elements[id];
};
const order = (name) => orders.find((button) => button.dataset.order === name);
const show = (status) => stream.fire("condition", { data: JSON.stringify({ ...vehicle, ...status }) });

before(async () => {
  Object.assign(page, {
    body: new Element("body"),
    documentElement: new Element("html"),
    activeElement: null,
    getElementById: at,
    createElement: (tag) => new Element(tag),
    createElementNS: (_, tag) => new Element(tag),
    querySelector: (which) => order(which.match(/data-order=(\w+)/)?.[1]) ?? new Element(which),
    querySelectorAll: (which) => [...orders, ...["step", "record"].filter((id) => which.includes(`#${id}`)).map(at)],
  });
  Object.assign(globalThis, {
    document: page,
    window: globalThis,
    requestAnimationFrame() {},
    addEventListener() {},
    matchMedia: () => new Element("media"),
    Option: class extends Element {},
    EventSource: class extends Element { constructor() { super("stream"); stream = this; } },
    async fetch(path, options) {
      sent.push(options ? path : "");
      return { ok: true, json: async () => [row], text: async () => "" };
    },
  });
  // Where nothing says that these are modules, Node takes them for scripts of the older kind.
  const folder = mkdtempSync(join(tmpdir(), "page-"));
  cpSync(fileURLToPath(new URL("../ground/src/vehicle/web/", import.meta.url)), folder, { recursive: true });
  writeFileSync(join(folder, "package.json"), '{"type": "module"}');
  await import(pathToFileURL(join(folder, "page.js")));
  await show({});
  await new Promise((done) => setTimeout(done));
});

test("Escape stops the vehicle from an edited field, too, and is nothing else", async () => {
  const field = at("parameters").children[0].children[1].children[0];
  assert.equal(field.value, "1");
  field.value = "1.25";
  sent.length = 0;
  await field.fire("keydown", { key: "Escape" });
  assert.deepEqual(sent, ["/stop"]);
  assert.equal(field.value, "1.25", "the edit stays");
  await field.fire("keydown", { key: "z", ctrlKey: true });
  assert.equal(field.value, "1", "what the vehicle has");
  assert.deepEqual(sent, ["/stop"]);
});

test("a recording can be ended while the vehicle is silent", async () => {
  await show({ connected: false, recording: "flight-001.tlog" });
  assert.equal(at("record").disabled, false);
  assert.equal(order("arm").disabled, true);
  await show({ connected: false });
  assert.equal(at("record").disabled, true);
  await show({});
  assert.equal(at("record").disabled, false);
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
