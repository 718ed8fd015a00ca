// The panel of the virtual rig: what a person can do to it by hand. It is there only for a rig.

import { make } from "./dom.js";

/** Buttons by group: label, action, what it does. */
const GROUPS = [
  ["Clamp", [
    ["Open", "clamp open", "Lets the drone go, whatever the firmware does"],
    ["Close", "clamp closed", "Catches the drone, and holds it"],
    ["Automatic", "clamp auto", "Opens when the firmware goes to active, closes when it is disarmed"],
  ]],
  ["Sensor in the hand", [
    ["Tremble", "sensor tremble", "Holds it unsteadily"],
    ["Turn", "sensor turn", "Turns it in all directions"],
    ["Put back", "sensor back", "Onto the drone"],
  ]],
  ["Pushes", [
    ["Knock up", "push 0.05", "An impulse of 0.05 N m s, nose up"],
    ["Knock down", "push -0.05", "An impulse of 0.05 N m s, nose down"],
    ["Gust up", "gust 0.1,0.5", "A torque of 0.1 N m for half a second, nose up"],
    ["Gust down", "gust -0.1,0.5", "A torque of 0.1 N m for half a second, nose down"],
  ]],
  ["Power and program", [
    ["Reset", "reset", "The reset button"],
    ["Power cycle", "power-cycle", "Cuts the power of chip and sensor for a moment; faults stay"],
    ["Brown-out", "brown-out", "The supply dips below the chip's brown-out level"],
    ["Hang", "program hang", "The main loop never comes back"],
    ["Hard fault", "program hard-fault", "The core meets what is no instruction"],
    ["Stack overflow", "program stack-overflow", "The stack grows into the statics"],
  ]],
  ["Cable and flash", [
    ["Pull the cable", "usb out", "USB goes away"],
    ["Put it in", "usb in", "USB is back"],
    ["Spoil what is stored", "store spoil", "The stored parameters cannot be read any more"],
    ["Erase what is stored", "store erase", "The stored parameters are gone"],
  ]],
];
/** Disturbances and parts: action, an example, what it is. */
const SETTINGS = [
  ["vibration", "5,180", "vibration: m/s², Hz"],
  ["servo-supply", "4.5", "servo supply: V"],
  ["thrust-ramp", "40,0.5", "thrust ramp: % at release, s"],
  ["temperature", "20,45,60", "temperature: from °C, to °C, s"],
  ["hardware", "stretch=400", "part that differs: KEY=VALUE"],
];

export class RigPanel {
  /** `act(action)` does an action and gives `{ error }` if it is refused. */
  constructor(section, act) {
    Object.assign(this, { section, act, faults: new Map() });
    this.state = make("p", { className: "soft" });
    this.chips = make("div", { className: "buttons" });
    this.said = make("p", { role: "status" });
    section.append(make("h2", { textContent: "Virtual rig" }), this.state, this.chips, this.said, this.tilt());
    for (const [title, buttons] of GROUPS) section.append(this.group(title, buttons));
    section.append(this.injection(), this.settings());
  }

  /** Asks once for the kinds of faults. */
  async learn() {
    if (this.asked) return;
    this.asked = true;
    try {
      const { faults } = await (await fetch("rig.json")).json();
      for (const { kind, share } of faults) {
        this.faults.set(kind, share);
        this.kind.append(make("option", { textContent: kind }));
      }
      this.choose();
    } catch {
      this.asked = false;
    }
  }

  /** Some faults strike a share of words or bytes only. */
  choose() { this.struck.hidden = !this.faults.get(this.kind.value); }

  async do(action) {
    const { error } = await this.act(action);
    this.said.textContent = error ?? `done: ${action}`;
    this.said.className = error ? "bad" : "soft";
  }

  button(label, action, title = "") {
    const button = make("button", { type: "button", textContent: label, title });
    button.addEventListener("click", () => this.do(typeof action === "string" ? action : action()));
    return button;
  }

  group(title, buttons) {
    const row = make("div", { className: "buttons" }, ...buttons.map((button) => this.button(...button)));
    return make("fieldset", {}, make("legend", { textContent: title }), row);
  }

  tilt() {
    const deg = make("input", { type: "number", min: -85, max: 85, step: 1, value: 23 });
    const label = make("label", {}, "tilt before a release ", deg, " deg ");
    const tilt = () => `tilt ${(deg.valueAsNumber * Math.PI / 180).toFixed(4)}`;
    const row = make("div", { className: "buttons" }, label, this.button("Tilt", tilt, "The clamp tilts the drone, and holds it there"));
    return make("fieldset", {}, make("legend", { textContent: "Tilt" }), row);
  }

  injection() {
    this.kind = make("select");
    const share = make("input", { type: "number", min: 0, max: 1, step: "any", value: 0.3 });
    const length = make("input", { type: "number", min: 0, step: "any", placeholder: "stays" });
    const struck = make("label", {}, "share ", share);
    this.struck = struck;
    this.kind.addEventListener("change", () => this.choose());
    const action = () => ["fault", this.kind.value,
      struck.hidden ? "" : `probability=${share.value}`,
      length.value === "" ? "" : `for_s=${length.value}`].filter(Boolean).join(" ");
    const row = make("div", { className: "buttons" }, make("label", {}, "kind ", this.kind), struck,
      make("label", {}, "for ", length, " s"), this.button("Inject", action, "From now on, in flight and at rest; for the start of the firmware, cycle the power then"),
      this.button("End all", "clear all"));
    return make("fieldset", {}, make("legend", { textContent: "Faults of sensor and cable" }), row);
  }

  settings() {
    const rows = SETTINGS.map(([name, example, words]) => {
      const value = make("input", { value: example });
      const row = make("div", { className: "setting" }, make("label", {}, make("span", { textContent: words }), value), this.button("Set", () => `${name} ${value.value.trim()}`));
      if (name !== "hardware") row.append(this.button("Off", `${name} off`));
      return row;
    });
    return make("fieldset", {}, make("legend", { textContent: "Disturbances and parts" }), ...rows);
  }

  /** `rig` is how the rig is, null where there is none. */
  show(rig) {
    this.section.hidden = !rig;
    if (!rig) return;
    this.learn();
    const clamp = { open: "opened by hand", closed: "closed by hand", auto: "automatic" }[rig.clamp];
    this.state.textContent = [
      `${rig.time_s.toFixed(1)} s since power-on`,
      `true pitch ${(rig.pitch_rad * 180 / Math.PI).toFixed(1)} deg`,
      `${rig.held ? "held" : "free"}, clamp ${clamp}`,
      `starts at ${(rig.start_rad * 180 / Math.PI).toFixed(0)} deg`,
      `cable ${rig.usb ? "in" : "out"}`,
      ...(rig.bootloader ? ["in its bootloader"] : []),
      ...rig.disturbances.map(([name, value]) => `${name} ${value}`),
    ].join(" · ");
    const on = rig.faults.join(" ");
    if (this.chips.dataset.on === on) return;
    this.chips.dataset.on = on;
    this.chips.replaceChildren(...rig.faults.map((kind) => this.button(`${kind} ×`, `clear ${kind}`, "Ends this fault")));
  }
}
