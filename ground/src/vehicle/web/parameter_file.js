// Parameters in a file: out by a download, in by a list of what would change, which is set when somebody agrees.

import { make } from "./dom.js";
import { forPage } from "./link.js";

/** Longest text that the program takes, bytes as JSON. */
const LONGEST = 16000;

const button = (words, act) => {
  const made = make("button", { type: "button", textContent: words });
  made.addEventListener("click", act);
  return made;
};

/** What a file would change: `[name, before, after]` each, the names that the vehicle does not have, and what is to be said besides. */
function differences(text, has) {
  const [notes, lines] = [[], []];
  for (const line of text.split("\n").filter(Boolean)) (line.startsWith("#") ? notes : lines).push(line.replace(/^# /, ""));
  const rows = lines.map((line) => line.split(/\s+/)).map(([name, value]) => [name, Number(value)]);
  return {
    notes,
    changes: rows.filter(([name, value]) => has(name) !== undefined && has(name) !== value).map(([name, value]) => [name, has(name), value]),
    unknown: rows.filter(([name]) => has(name) === undefined).map(([name]) => name),
    count: rows.length,
  };
}

export class ParameterFile {
  /** `order(name, fields)` asks the program; `parameters` is the table. */
  constructor({ write, read, input, place }, order, parameters) {
    Object.assign(this, { place, order, parameters });
    write.addEventListener("click", () => this.write());
    read.addEventListener("click", () => input.click());
    input.addEventListener("change", async () => {
      const [file] = input.files;
      input.value = "";
      if (!file) return;
      try {
        const text = await file.text();
        this.read(file.name, text);
      } catch (problem) {
        this.say(`${file.name}: ${problem.message}`);
      }
    });
  }

  say(...parts) { this.place.replaceChildren(...parts.map((part) => (typeof part === "string" ? make("p", { textContent: part }) : part))); }

  async write() {
    const { error, note } = await this.order("write-file");
    if (error) return this.say(error);
    const href = URL.createObjectURL(new Blob([note], { type: "text/plain" }));
    const link = make("a", { href, download: "tvc-nano.parm" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  async read(name, text) {
    if (new Blob([JSON.stringify(text)]).size > LONGEST) return this.say(`${name}: too long for a parameter file`);
    const { error, note } = await this.order("read-file", { text });
    if (error) return this.say(`${name}: ${error}`);
    const { changes, unknown, count, notes } = differences(note, (key) => this.parameters.value(key));
    const said = notes.map(forPage);
    const other = unknown.length ? [...said, `The vehicle has no parameter ${unknown.join(", ")}.`] : said;
    if (changes.length === 0) return this.say(`${name}: the vehicle has all of its ${count - unknown.length} values.`, ...other);
    const list = make("ul", {}, ...changes.map(([key, before, after]) => make("li", { textContent: `${key}: ${before} → ${after}` })));
    const set = button(`Set ${changes.length}`, () => this.set(name, changes));
    const buttons = make("div", { className: "buttons" }, set, button("Cancel", () => this.say()));
    this.say(`${name} differs in ${changes.length} of ${count} values:`, list, ...other, buttons);
  }

  /** Sets the values one by one, so that each refusal is shown; none while the vehicle is in control. */
  async set(name, changes) {
    if (this.parameters.inControl) return this.say("The vehicle is in control: disarm first.");
    const refused = [];
    this.say(`${name}: being set …`);
    for (const [key, , value] of changes) {
      const { error } = await this.order("set", { name: key, value });
      if (error) refused.push(`${key}: ${error}`);
    }
    this.say(`${name}: ${changes.length - refused.length} of ${changes.length} set; Save keeps them.`, ...refused);
  }
}
