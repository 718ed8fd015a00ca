// The recordings of the page's folder: listed, downloaded, and their reports read in the page.

import { make } from "./dom.js";
import { unfold } from "./sections.js";

/** The name of a log without its folder. */
export const nameOf = (path) => path.split(/[\\/]/).pop();

export class Logs {
  /** `token()` gives the token of this start, without which nothing is told. */
  constructor(section, token) {
    Object.assign(this, { section, token });
    this.said = make("p", { role: "status" });
    this.rows = make("tbody");
    const head = make("tr", {}, ...["name", "date", "length", "size"].map((words) => make("th", { textContent: words })), make("td"));
    const again = make("button", { type: "button", textContent: "List again" });
    again.addEventListener("click", () => this.list());
    this.report = make("div", { id: "report", hidden: true });
    section.append(make("h2", { textContent: "Recordings" }), make("div", { className: "buttons" }, again), this.said,
      make("div", { className: "rows", tabIndex: 0, role: "region", ariaLabel: "Recordings" }, make("table", {}, make("thead", {}, head), this.rows)), this.report);
  }

  async get(path) {
    const answer = await fetch(path, { headers: { Authorization: `Bearer ${this.token()}` } });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    return answer;
  }

  /** Does something and tells why it failed. */
  async try(what) {
    try {
      this.said.textContent = "";
      this.said.className = "";
      await what();
    } catch (problem) {
      this.said.textContent = problem.message;
      this.said.className = "bad";
    }
  }

  list() {
    return this.try(async () => {
      const logs = await (await this.get("logs")).json();
      this.rows.replaceChildren(...logs.map((log) => this.row(log)));
      if (logs.length === 0) this.said.textContent = "none so far";
    });
  }

  row({ name, begun_ms, seconds, bytes }) {
    const date = begun_ms === null ? "–" : new Date(begun_ms).toLocaleString();
    const size = bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
    const cells = [name, date, seconds === null ? "–" : `${seconds.toFixed(1)} s`, size];
    return make("tr", {}, ...cells.map((words) => make("td", { textContent: words })), make("td", {}, this.links(name)));
  }

  /** Buttons that open the report of a log and download it. */
  links(name) {
    const button = (label, does, words) => {
      const made = make("button", { type: "button", textContent: label, title: `${words} ${name}` });
      made.addEventListener("click", does);
      return made;
    };
    return make("span", { className: "links" },
      button("Report", () => this.open(name), "The report of"),
      button("Download", () => this.download("logs", name, name), "Download"));
  }

  download(kind, name, as) {
    return this.try(async () => {
      const file = await (await this.get(`${kind}/${encodeURIComponent(name)}`)).blob();
      const url = URL.createObjectURL(file);
      make("a", { href: url, download: as }).click();
      setTimeout(() => URL.revokeObjectURL(url), 60_000);
    });
  }

  /** Shows the page of `tvc report` in this one: STOP stays in sight, and Esc is heard. */
  open(name) {
    return this.try(async () => {
      const text = await (await this.get(`reports/${encodeURIComponent(name)}`)).text();
      // The page's rules forbid style elements, not style sheets that are made here.
      let style = "";
      const bare = text.replace(/<style>([^<]*)<\/style>/, (_, inner) => {
        style = inner.replaceAll(":root", ":host");
        return "";
      });
      const page = new DOMParser().parseFromString(bare, "text/html");
      const sheet = new CSSStyleSheet();
      sheet.replaceSync(style);
      const frame = make("div");
      const shadow = frame.attachShadow({ mode: "open" });
      shadow.adoptedStyleSheets = [sheet];
      shadow.append(document.importNode(page.body, true));
      const close = make("button", { type: "button", textContent: "Close the report" });
      close.addEventListener("click", () => { this.report.hidden = true; });
      const save = make("button", { type: "button", textContent: "Save as HTML" });
      save.addEventListener("click", () => this.download("reports", name, `${name.replace(/\.[^.]*$/, "")}.html`));
      this.report.replaceChildren(make("div", { className: "buttons" }, close, save), frame);
      this.report.hidden = false;
      unfold(this.section);
      this.report.scrollIntoView({ block: "start" });
    });
  }
}
