// The last releases over each other: pitch and servo from the moment of the release on, and a table of figures.

import { colour, style } from "./charts.js";
import { make } from "./dom.js";
import { TITLES } from "./tests.js";

const HUES = ["blue", "amber", "teal", "violet", "red", "green", "slate", "ink"];
/** Share of the tilt within which pitch has settled. */
const BAND = 0.05;
/** Up to this tilt no percentage of it is drawn, deg. */
const LEAST = 2;

const degrees = (value) => (value * 180) / Math.PI;
const seconds = (value) => (value === null ? "never" : value.toFixed(3));
const hue = (release) => HUES[(release.number - 1) % HUES.length];

export class Releases {
  constructor(section, parent, table, unit) {
    Object.assign(this, { section, parent, body: table.tBodies[0], unit, releases: [], hidden: new Set(), plots: [] });
    unit.addEventListener("change", () => this.draw());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    new ResizeObserver(() => {
      for (const plot of this.plots) if (parent.clientWidth > 0 && parent.clientWidth !== plot.width) plot.setSize({ width: parent.clientWidth, height: plot.height });
    }).observe(parent);
  }

  show(releases) {
    this.releases = releases;
    this.section.hidden = releases.length === 0;
    this.body.replaceChildren(...[...releases].reverse().map((release) => this.row(release)));
    this.draw();
  }

  /** What the table says of a release. */
  row(release) {
    const { run } = release;
    const box = make("input", { type: "checkbox", checked: !this.hidden.has(release.number) });
    box.addEventListener("change", () => {
      if (box.checked) this.hidden.delete(release.number);
      else this.hidden.add(release.number);
      this.draw();
    });
    const key = make("span", { textContent: "—" });
    key.style.color = `var(--${hue(release)})`;
    const name = `${release.number}, ${TITLES[release.test]?.toLowerCase() ?? "by hand"} at ${release.time_s.toFixed(1)} s`;
    const log = [release.log?.split(/[/\\]/).at(-1), release.stayed ? "" : "ended in a failsafe"].filter(Boolean).join("; ");
    const cells = [
      release.start_deg.toFixed(1),
      run ? seconds(run.rise_s) : "–",
      run ? run.overshoot_pct.toFixed(1) : "–",
      run ? seconds(run.settling_5pct_s) : "–",
      run ? degrees(run.final_error_rad).toFixed(2) : "the set point moved",
      release.changes.map(([name, before, now]) => `${name} ${before} → ${now}`).join(", ") || "–",
    ].map((textContent) => make("td", { textContent }));
    return make("tr", {}, make("td", {}, make("label", {}, box, key, ` ${name}`)), ...cells,
      make("td", { textContent: log || "–", title: release.log ?? "" }));
  }

  /** The charts anew. */
  draw() {
    const percent = this.unit.value === "percent";
    const shown = this.releases.filter((release) => !this.hidden.has(release.number) && (!percent || Math.abs(release.start_deg) > LEAST));
    // Each has its own times: its line goes on over the times of the others (spanGaps).
    const traces = (of) => uPlot.join(shown.map((release) => [release.trace.map(([time]) => time), release.trace.map((point) => of(release, point))]));
    const pitch = (release, [, deg]) => (percent ? (100 * (deg - release.set_deg)) / release.start_deg : deg - release.set_deg);
    const newest = shown.at(-1);
    const band = percent ? 100 * BAND : BAND * Math.abs(newest?.start_deg ?? 0);
    for (const plot of this.plots) plot.destroy();
    this.plots = [];
    if (!newest) return;
    const series = [{}, ...shown.map((release) => ({ stroke: colour(hue(release)), width: release === newest ? 2 : 1, spanGaps: true, points: { show: false } }))];
    this.plots = [
      this.plot(percent ? "pitch, % of the tilt at the release" : "pitch from the set point, deg", 220, series, traces(pitch), band),
      this.plot("rudder servo, deg", 130, series, traces((_, point) => point[2]), 0),
    ];
  }

  plot(title, height, series, data, band) {
    const drawBand = (plot) => {
      if (!band) return;
      const [top, bottom] = [band, -band].map((value) => plot.valToPos(value, "y", true));
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.fillStyle = colour("line");
      ctx.fillRect(bbox.left, top, bbox.width, bottom - top);
      ctx.restore();
    };
    const plot = new uPlot({
      ...style({ values: (_, ticks) => ticks.map((tick) => `${tick} s`) }, {}),
      title, width: this.parent.clientWidth || 300, height, padding: [6, 8, 0, 0],
      series, scales: { x: { time: false } },
      cursor: { sync: { key: "releases" }, y: false },
      hooks: { drawClear: [drawBand] },
    }, data, this.parent);
    return plot;
  }
}
