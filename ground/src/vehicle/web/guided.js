// The set-up: its steps, what is to be done now, questions and what was found.

import { make } from "./dom.js";

/** How long a new question takes no answer, ms: a click or a key may have been meant for the one before. */
const PAUSE = 400;

/** What the vehicle's parameters tell of each step: whether it is done, in words. */
function known(parameters) {
  const value = new Map(parameters.map((row) => [row.name, row.value]));
  const changed = (is) => parameters.some((row) => is(row.name) && row.default !== null && row.value !== row.default);
  const done = (is, yes, no) => ({ done: is, words: is ? yes : no });
  const hold = value.get("SRV_HOLD_DEG") ?? 0;
  const axes = ["SRV_POLARITY", "SRV2_POLARITY"].slice(0, value.get("AXES"));
  const seen = axes.every((name) => value.get(name) === 1);
  const servo = ["SRV_CENTRE_US", "SRV_US_PER_DEG", "SRV_DIR", "SRV_MIN_US", "SRV_MAX_US"];
  return {
    sensors: done(changed((name) => name.startsWith("CAL_")), "calibrated", "not calibrated"),
    // Defaults may be right: whoever has seen the rudder answer knows.
    servo: done(seen || changed((name) => servo.includes(name)), "set up", "default values"),
    polarity: done(seen, "checked", "not checked: nothing is armed"),
    hold: done(hold !== 0, `${hold} deg`, "none"),
  };
}

export class Guided {
  /** `press(order, words, fields)` sends an order and tells how it went. */
  constructor(section, press) {
    const at = (name) => section.querySelector(`.${name}`);
    Object.assign(this, { section, at, press, now: { running: false }, free: false, known: null, asked: null });
    for (const button of section.querySelectorAll("[data-step]")) {
      button.addEventListener("click", () => press("set-up", "", { step: button.dataset.step }));
    }
    at("cancel").addEventListener("click", () => press("cancel", ""));
    at("entry").addEventListener("submit", (event) => {
      event.preventDefault();
      if (this.reply(at("typed").value)) at("typed").value = "";
    });
  }

  get running() { return this.now.running; }

  /** An answer is for the question in sight; the program refuses one to any other. Tells whether it is sent. */
  reply(reply) {
    if (performance.now() < this.from) return false;
    // Without words: a message that appears and vanishes would move the buttons.
    this.press("answer", "", { question: this.asked, reply });
    return true;
  }

  /** Whether a step may begin. */
  control(free) {
    this.free = free;
    for (const button of this.section.querySelectorAll("[data-step]")) button.disabled = !free || this.running;
  }

  /** Nothing can be pressed while the program is silent. */
  silence(silent) {
    for (const button of this.section.querySelectorAll("button")) button.disabled = silent;
    if (!silent) this.control(this.free);
  }

  tell(parameters) {
    if (parameters.length === 0) return;
    const first = this.known === null;
    this.known = known(parameters);
    for (const [step, { done, words }] of Object.entries(this.known)) {
      const mark = this.section.querySelector(`[data-state=${step}]`);
      mark.textContent = words;
      mark.classList.toggle("done", done);
    }
    const { sensors, polarity } = this.known;
    this.at("summary").textContent = `sensors ${sensors.words}, polarity ${polarity.words}`;
    // The section stays closed for a vehicle that is set up.
    if (first && !(sensors.done && polarity.done)) this.section.querySelector("details").open = true;
  }

  show(now) {
    const began = now.running && !this.running;
    this.now = now;
    const { at } = this;
    if (began) this.section.querySelector("details").open = true;
    this.section.classList.toggle("running", now.running);
    at("guide").hidden = !now.running && !now.ending;
    at("instruction").textContent = now.instruction;
    at("progress").hidden = now.share === null;
    at("share").value = now.share ?? 0;
    at("words").textContent = now.progress;
    this.showSeen(now.seen);
    this.ask(now.question);
    at("lines").replaceChildren(...now.lines.map((line) => make("li", { textContent: line })));
    at("found").replaceChildren(...now.figures.map(([name, value]) =>
      make("tr", {}, make("th", { textContent: name, scope: "row" }), make("td", { textContent: value }))));
    at("ending").textContent = now.ending;
    at("ending").classList.toggle("met", now.met);
    at("cancel").hidden = !now.running;
    for (const button of at("guide").querySelectorAll("button")) button.disabled = false;
    this.control(this.free);
  }

  /** The cells of the sphere of directions, the highest band first; the more often a direction was seen, the more opaque. */
  showSeen(seen) {
    const box = this.at("seen");
    box.hidden = seen === null;
    if (seen === null) return;
    const level = (count) => (count === 0 ? "never" : count < 4 ? "seldom" : count < 10 ? "some" : "often");
    box.replaceChildren(...[...seen].reverse().flat().map((count) => make("i", { className: level(count) })));
  }

  ask(question) {
    const { at } = this;
    at("question").hidden = question === null;
    if (question === null || question.id === this.asked) return;
    this.asked = question.id;
    at("asked").textContent = question.words;
    // For the same question again the buttons stay, and with them the focus.
    if (question.again && at("replies").childElementCount > 0) return;
    this.from = performance.now() + PAUSE;
    at("replies").replaceChildren(...question.buttons.map(([label, reply]) => {
      const button = make("button", { type: "button", textContent: label });
      button.addEventListener("click", () => this.reply(reply));
      return button;
    }));
    at("typed").value = "";
    at("entry").hidden = question.entry === null;
    at("unit").textContent = question.entry ?? "";
  }
}
