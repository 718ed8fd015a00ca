// The table of parameters: what the vehicle has, and what it says to a change.

const cell = (row, text, kind) => {
  const td = row.insertCell();
  if (text !== undefined) td.textContent = text;
  if (kind) td.className = kind;
  return td;
};

/** A field in which the value can be changed. */
function field(parameter) {
  if (parameter.choices) {
    const select = document.createElement("select");
    for (const choice of parameter.choices) select.add(new Option(String(choice), String(choice)));
    return select;
  }
  const input = document.createElement("input");
  input.type = "number";
  input.step = "any";
  if (parameter.between) [input.min, input.max] = parameter.between;
  return input;
}

/** Keeps a table like the vehicle's parameters; `set(name, value)` gives the vehicle's refusal, or nothing. */
export class Parameters {
  constructor(table, set) {
    this.body = table.tBodies[0];
    this.set = set;
    this.rows = new Map();
  }

  /** Shows what the vehicle has; a field that is being edited is left alone. */
  show(parameters) {
    for (const parameter of parameters) {
      const row = this.rows.get(parameter.name) ?? this.add(parameter);
      row.value = parameter.value;
      if (row.field !== document.activeElement) row.field.value = String(parameter.value);
      row.cell.classList.toggle("changed", parameter.default !== null && parameter.value !== parameter.default);
    }
  }

  add(parameter) {
    const tr = this.body.insertRow();
    cell(tr, parameter.name, "name");
    const td = cell(tr);
    const input = field(parameter);
    input.setAttribute("aria-label", parameter.name);
    const refusal = document.createElement("span");
    refusal.className = "refusal";
    td.append(input, refusal);
    cell(tr, parameter.unit);
    cell(tr, parameter.range);
    cell(tr, parameter.default ?? "");
    cell(tr, parameter.live ? parameter.meaning : `${parameter.meaning} (only while disarmed)`);
    const row = { field: input, cell: td, value: parameter.value };
    input.addEventListener("change", async () => {
      const said = await this.wish(parameter.name, input.value);
      refusal.textContent = said;
      if (said) input.value = String(row.value);
    });
    input.addEventListener("keydown", (event) => {
      // Not by Escape, which is STOP wherever it is pressed.
      if (event.key.toLowerCase() !== "z" || !(event.ctrlKey || event.metaKey)) return;
      event.preventDefault();
      input.value = String(row.value);
    });
    this.rows.set(parameter.name, row);
    return row;
  }

  async wish(name, text) {
    const value = Number(text);
    if (text.trim() === "" || !Number.isFinite(value)) return `${text || "nothing"} is no number`;
    return await this.set(name, value) ?? "";
  }
}
