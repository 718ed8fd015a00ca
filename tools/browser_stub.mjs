// A stand-in for the browser, with as much of it as the scripts of the page use: elements without a layout, a document,
// a WebSocket whose other end is the test, and requests by HTTP that nobody answers.

import { cpSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

/** As much of an element as the scripts use. */
export class Element {
  constructor(tag) {
    Object.assign(this, { tag, listeners: {}, children: [], dataset: {}, style: {}, parent: null, value: "", textContent: "" });
    this.classes = new Set();
    this.classList = {
      contains: (name) => this.classes.has(name),
      toggle: (name, on = !this.classes.has(name)) => { this.classes[on ? "add" : "delete"](name); },
    };
    Object.assign(this, { written: [], clientWidth: 600, clientHeight: 200 });
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
    for (const part of children) {
      const child = part instanceof Element ? part : Object.assign(new Element("text"), { textContent: part });
      // What stands elsewhere moves.
      if (child.parent) child.parent.children = child.parent.children.filter((other) => other !== child);
      child.parent = this;
      this.children.push(child);
    }
  }
  prepend(...children) { this.append(...children); }
  replaceChildren(...children) { this.children = []; this.append(...children); }
  add(option) { this.append(option); }
  insertRow() { return this.insert("tr"); }
  insertCell() { return this.insert("td"); }
  createTBody() { return this.insert("tbody"); }
  insert(tag) {
    const child = new Element(tag);
    this.append(child);
    return child;
  }
  get valueAsNumber() { return Number(this.value); }
  get tBodies() { return [this]; }
  get firstElementChild() { return this.children[0]; }
  get lastElementChild() { return this.children.at(-1); }
  get childElementCount() { return this.children.length; }
  querySelector(which) { return (this.found ??= {})[which] ??= new Element(which); }
  /** The elements inside this one that have this tag. */
  querySelectorAll(tag) {
    const inside = [...this.children, ...Object.values(this.found ?? {})];
    return inside.flatMap((child) => [...child.tag === tag ? [child] : [], ...child.querySelectorAll(tag)]);
  }
  remove() { this.parent.children.splice(this.parent.children.indexOf(this), 1); }
  setAttribute(name, value) { this[name] = value; }
  blur() { this.left = true; }
  get childNodes() { return [...this.children]; }
  get files() { return this.chosen ?? []; }
  click() { return this.fire("click"); }
  /** Whatever is written into a canvas. */
  getContext() { return new Proxy({}, { get: (_, name) => (name === "fillText" ? (words) => this.written.push(words) : () => {}), set: () => true }); }
}

/** As much of uPlot as the scripts use: what was asked of the newest ones. */
export class Plot {
  static made = [];
  static join(tables) { return [tables[0][0], ...tables.map(([, values]) => values)]; }
  constructor(options, data) {
    Object.assign(this, { options, data, cursor: { left: -10 }, scales: {}, series: options.series.map(() => ({})) });
    Plot.made.push(this);
  }
  batch(act) { act(); }
  setData(data) { this.data = data; }
  setScale(key, range) { this.scales[key] = range; }
  setSize() {}
  destroy() { Plot.made = Plot.made.filter((plot) => plot !== this); }
}

export const page = new Element("document");
const elements = {};
export const orders = ["arm", "release", "calibrate", "save", "reload", "reset"].map((order) => {
  const button = new Element("button");
  button.dataset.order = order;
  page.append(button);
  return button;
});
export const tests = ["step", "hold", "chirp"].map((name) => {
  const button = new Element("button");
  button.dataset.test = name;
  page.append(button);
  return button;
});
/** The orders that were sent to the program, and the requests by HTTP. */
export const [sent, requests] = [[], []];
/** Each ends a request by HTTP with an error. */
export const ends = [];
/** Where the scripts are as modules. */
let folder = "";
/** The page's end of the WebSocket. */
export let socket = null;
/** What the page has asked to be called for its next picture. */
export let draw = null;
/** The element of this id. */
export const at = (id) => {
  if (!elements[id]) page.append(elements[id] = new Element(id));
  return elements[id];
};
/** The button of this order. */
export const order = (name) => orders.find((button) => button.dataset.order === name);

/** A script of the page, as a module. */
export const script = (name) => import(pathToFileURL(join(folder, name)));

/** Makes this process look like a browser, and starts the page's scripts in it. */
export async function openPage() {
  Object.assign(page, {
    body: new Element("body"),
    documentElement: new Element("html"),
    activeElement: null,
    getElementById: at,
    createElement: (tag) => new Element(tag),
    createElementNS: (_, tag) => new Element(tag),
    querySelector: (which) => order(which.match(/data-order=(\w+)/)?.[1]) ?? at(which),
    querySelectorAll: (which) => [
      ...which.includes("data-order") ? orders : [],
      ...which.includes("data-test") ? tests : [],
      ...which.includes("#record") ? [at("record")] : [],
    ],
  });
  Object.assign(globalThis, {
    document: page,
    window: globalThis,
    requestAnimationFrame(paint) { draw = paint; },
    getComputedStyle: () => ({ getPropertyValue: () => "" }),
    addEventListener() {},
    location: { host: "127.0.0.1:8650", hash: "#token=secret" },
    matchMedia: () => new Element("media"),
    ResizeObserver: class { observe() {} },
    IntersectionObserver: class { observe() {} },
    uPlot: Plot,
    Option: class extends Element {},
    WebSocket: class extends Element {
      constructor(url) { super(url); socket = this; }
      send(text) { sent.push(JSON.parse(text)); }
      close() {}
    },
    /** A request by HTTP is not answered; it ends with the test. */
    fetch(path, options) {
      requests.push([path, options?.headers]);
      return new Promise((_, end) => { ends.push(end); });
    },
  });
  // Where nothing says that these are modules, Node takes them for scripts of the older kind.
  folder = mkdtempSync(join(tmpdir(), "page-"));
  process.on("exit", () => rmSync(folder, { recursive: true }));
  cpSync(fileURLToPath(new URL("../ground/src/vehicle/web/", import.meta.url)), folder, { recursive: true });
  writeFileSync(join(folder, "package.json"), '{"type": "module"}');
  await script("page.js");
}
