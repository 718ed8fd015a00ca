// The table of parameters: what the vehicle has, and what it says to a change.

const cell = (row, text, kind) => {
  const td = row.insertCell();
  if (text !== undefined) td.textContent = text;
  if (kind) td.className = kind;
  return td;
};

/** About a thousandth of a range, as 1, 2 or 5 times a power of ten. */
function stepOf([low, high]) {
  const raw = (high - low) / 1000;
  const power = 10 ** Math.floor(Math.log10(raw));
  return Number((power * [1, 2, 5, 10].find((factor) => factor * power >= raw * 0.999)).toPrecision(1));
}

/** A field in which the value can be changed. */
function field(parameter) {
  if (parameter.choices) {
    const select = document.createElement("select");
    for (const choice of parameter.choices) select.add(new Option(String(choice), String(choice)));
    return select;
  }
  const input = document.createElement("input");
  input.type = "number";
  input.step = parameter.between ? String(stepOf(parameter.between)) : "any";
  return input;
}

/** Whether somebody has changed it from its default, or since it was stored. */
const isChanged = ({ measured, value, default: usual }) => !measured && usual !== null && value !== usual;
const isUnsaved = ({ value, stored }) => stored !== null && stored !== undefined && value !== stored;

/** Keeps a table like the vehicle's parameters; `set(name, value)` gives what became of it. */
export class Parameters {
  /** `parts`: table, undo, search, only, count and save, the elements of the page. */
  constructor(parts, set) {
    Object.assign(this, parts, { set, rows: new Map(), groups: new Map(), last: null, inControl: false, agreed: false });
    this.undo.addEventListener("click", () => this.back());
    this.search.addEventListener("input", () => this.filter());
    this.search.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      // As in a value's field: it is left, and anywhere else Escape is STOP.
      event.stopPropagation();
      this.search.value = "";
      this.search.blur();
      this.filter();
    });
    this.only.addEventListener("change", () => this.filter());
    this.showUndo();
  }

  /** The value that the vehicle has; undefined for what it does not have. */
  value(name) { return this.rows.get(name)?.parameter.value; }

  /** Shows what the vehicle has; a field that is being edited is left alone. Without any, they are not known yet. */
  show(parameters) {
    const names = new Set(parameters.map(({ name }) => name));
    for (const [name, row] of this.rows) if (names.size > 0 && !names.has(name)) this.drop(row);
    for (const parameter of parameters) {
      const row = this.rows.get(parameter.name) ?? this.add(parameter);
      row.parameter = parameter;
      this.place(row);
      if (row.field !== document.activeElement && row.question === null) row.field.value = String(parameter.value);
      const [changed, unsaved] = [isChanged(parameter), isUnsaved(parameter)];
      row.cell.classList.toggle("changed", changed);
      row.range.textContent = changed ? `${parameter.range}; default ${parameter.default}` : parameter.range;
      row.mark.textContent = unsaved ? "not saved" : "";
      row.mark.title = unsaved ? `in flash: ${parameter.stored}` : "";
    }
    this.filter();
  }

  /** The rows that are asked for, in groups that open by themselves where something is looked for. */
  filter() {
    const words = this.search.value.trim().toLowerCase();
    const [total, looking] = [{ changed: 0, unsaved: 0 }, words !== "" || this.only.checked];
    for (const group of this.groups.values()) {
      let [changed, shown] = [0, 0];
      for (const { tr, parameter } of group.rows) {
        const different = isChanged(parameter) || isUnsaved(parameter);
        const found = `${parameter.name} ${parameter.meaning}`.toLowerCase().includes(words) && (different || !this.only.checked);
        tr.hidden = looking ? !found : !group.open;
        changed += isChanged(parameter);
        shown += found;
        total.unsaved += isUnsaved(parameter);
      }
      total.changed += changed;
      group.body.hidden = group.rows.length === 0 || (looking && shown === 0);
      group.button.textContent = changed ? `${group.name} · ${changed} changed` : group.name;
      group.button.setAttribute("aria-expanded", String(looking || group.open));
    }
    const counted = `${total.changed} changed from the defaults, ${total.unsaved} not saved`;
    if (this.count.textContent !== counted) this.count.textContent = counted;
    this.save.classList.toggle("wanted", total.unsaved > 0);
  }

  /** A group begins with a button that opens and closes it; the first one is open. */
  group(name) {
    const made = { name, rows: [], open: this.groups.size === 0, body: this.table.createTBody(), button: document.createElement("button") };
    const head = document.createElement("th");
    head.setAttribute("colspan", "5");
    head.setAttribute("scope", "rowgroup");
    Object.assign(made.button, { type: "button", className: "fold" });
    made.button.addEventListener("click", () => {
      made.open = !made.open;
      this.filter();
    });
    head.append(made.button);
    made.body.insertRow().append(head);
    this.groups.set(name, made);
    return made;
  }

  /** While the vehicle is in control the first change is asked for; what was agreed to ends with it. */
  control(inControl) {
    this.inControl = inControl;
    if (inControl) return;
    this.agreed = false;
    for (const row of this.rows.values()) if (row.question) this.restore(row);
  }

  /** Moves a row to its group: another control law uses other gains. */
  place(row) {
    const { parameter: { group: name }, group: before } = row;
    if (before.name === name) return;
    before.rows = before.rows.filter((other) => other !== row);
    row.group = this.groups.get(name) ?? this.group(name);
    row.group.rows.push(row);
    row.group.body.append(row.tr);
  }

  add(parameter) {
    const group = this.groups.get(parameter.group) ?? this.group(parameter.group);
    const tr = group.body.insertRow();
    const mark = document.createElement("span");
    mark.className = "unsaved";
    cell(tr, parameter.name, "name").append(mark);
    const td = cell(tr);
    const input = field(parameter);
    input.setAttribute("aria-label", parameter.name);
    const said = document.createElement("span");
    said.className = "refusal";
    td.append(input, said);
    cell(tr, parameter.unit);
    const range = cell(tr, parameter.range);
    cell(tr, parameter.live ? parameter.meaning : `${parameter.meaning} (only while disarmed)`);
    const row = { group, tr, field: input, cell: td, range, mark, said, parameter, question: null };
    group.rows.push(row);
    input.addEventListener("change", () => this.wish(row, input.value));
    input.addEventListener("keydown", (event) => {
      const back = event.key.toLowerCase() === "z" && (event.ctrlKey || event.metaKey);
      if (!back && event.key !== "Escape") return;
      event.preventDefault();
      this.restore(row);
      if (back) return;
      // Escape leaves the field here; anywhere else it is STOP.
      event.stopPropagation();
      input.blur();
    });
    this.rows.set(parameter.name, row);
    return row;
  }

  /** Takes out a row that another firmware does not have. */
  drop(row) {
    row.tr.remove();
    row.group.rows = row.group.rows.filter((other) => other !== row);
    this.rows.delete(row.parameter.name);
    if (this.last?.row === row) this.last = null;
    this.showUndo();
  }

  /** What was typed: nothing that is out of range is sent, and nothing unasked in control. */
  wish(row, text) {
    const { name, value: before, between, range } = row.parameter;
    const value = Number(text);
    if (text.trim() === "" || !Number.isFinite(value)) return this.refuse(row, `${text || "nothing"} is no number`);
    if (between && (value < between[0] || value > between[1])) return this.refuse(row, `${name} must be ${range}`);
    if (value === before) return this.say(row, "");
    if (!this.inControl || this.agreed) return this.change(row, value);
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `The vehicle is in control. Change to ${value}`;
    button.addEventListener("click", () => {
      this.agreed = true;
      this.change(row, value);
    });
    this.say(row, "");
    row.question = button;
    row.said.append(button);
  }

  async change(row, value) {
    const { name, value: before } = row.parameter;
    this.say(row, "");
    const { error } = await this.set(name, value);
    if (error) return this.refuse(row, error);
    this.last = { row, before };
    this.showUndo();
  }

  /** The newest change is taken back, and can be made again in the same way. */
  async back() {
    if (!this.last) return;
    const { row, before } = this.last;
    row.field.value = String(before);
    await this.change(row, before);
  }

  showUndo() {
    this.undo.disabled = this.last === null;
    this.undo.textContent = this.last ? `Undo ${this.last.row.parameter.name}: back to ${this.last.before}` : "Undo";
  }

  refuse(row, words) {
    this.say(row, words);
    row.field.value = String(row.parameter.value);
  }

  restore(row) { this.refuse(row, ""); }

  say(row, words) {
    row.question = null;
    row.said.replaceChildren();
    row.said.textContent = words;
  }
}
