// What a test has found, as rows of names and figures.

const deg = (rad, digits) => `${(rad * 180 / Math.PI).toFixed(digits)} deg`;
const seconds = (value) => (value === null ? "never" : `${value.toFixed(3)} s`);

/** How the tests are called on the page. */
export const TITLES = { step: "Step test", hold: "Hold test", chirp: "Chirp test" };

/** Rows of a test's result: of the step, of how it was held, of the sweep, and of the link. */
export function rowsOf({ run, hold, sweep, loop, telemetry }) {
  return [
    ...(!run ? [] : [
      ["tilt at release", deg(run.start_rad, 1)],
      ["rise", seconds(run.rise_s)],
      ["overshoot", `${run.overshoot_pct.toFixed(1)} %`],
      ["settling to 5 %", seconds(run.settling_5pct_s)],
      ["final error", deg(run.final_error_rad, 2)],
      ["stayed in control", run.stayed_active ? "yes" : "no"],
    ]),
    ...(!hold ? [] : [
      ["mean error", deg(hold.mean_error_rad, 2)],
      ["rms", deg(hold.rms_error_rad, 2)],
      ["worst", deg(hold.max_error_rad, 2)],
    ]),
    ...(!sweep ? [] : [
      ["bandwidth", sweep.bandwidth_hz === null ? "above 4 Hz" : `${sweep.bandwidth_hz.toFixed(2)} Hz`],
      ["delay", `${(sweep.delay_s * 1e3).toFixed(0)} ms`],
    ]),
    ["loop jitter", `${loop.jitter_us_max.toFixed(0)} us`],
    ["messages lost", String(telemetry.lost)],
  ];
}
