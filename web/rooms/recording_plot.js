/**
 * The plot of a recording: signals of one unit share a panel. What is zoomed into is asked for anew, so that at last
 * every row is seen; until then the extremes of what a point stands for are drawn. Another recording can lie over it.
 *
 * @typedef {import("../api.js").Recording} Recording
 * @typedef {import("../api.js").Samples} Samples
 * @typedef {import("../api.js").Mark} Mark
 */

import { readSamples } from "../api.js";
import { make } from "../dom.js";
import { HOW_ZOOMED, STILL, axisOf, baseLayout, copiesCsv, drawOn, palette } from "../plot.js";
import { nameOf } from "./recording_name.js";

const POINTS = 1500;
const USUAL = ["i_d", "i_q", "u_d", "u_q", "omega_e"];
const NOT_PLOTTED = ["t"];
const PANEL_PX = 150;

export function recordingPlot() {
  const canvas = make("div", { id: "recording-canvas", class: "canvas", role: "img" });
  const choices = make("fieldset", { class: "signals-choice" });
  const csv = make("button", { type: "button", class: "small", id: "recording-csv" }, "Copy CSV");
  const back = make("button", { type: "button", class: "small", id: "recording-all-of-it", hidden: true }, "All of it");
  const words = make("p", { class: "section-note", id: "recording-thinned", role: "status" });
  const root = make("figure", { class: "recording-plot" }, make("div", { class: "entry" }, choices, back, csv), words, canvas);

  /** @type {Recording | null} */
  let one = null;
  /** The one over it. @type {Recording | null} */
  let second = null;
  /** @type {Mark[]} */
  let marks = [];
  /** @type {string[]} */
  let signals = [];
  /** What is shown, in s. @type {[number, number] | null} */
  let range = null;
  /** @type {Samples[]} */
  let told = [];
  let asked = 0;
  /** @type {(t: number) => void} */
  let listener = () => {};
  let listening = false;

  async function ask() {
    const mine = ++asked;
    if (one === null) { told = []; return draw(); }
    if (signals.length === 0) { told = []; words.textContent = "Choose what to plot."; return draw(); }
    words.textContent = "Reading …";
    try {
      const got = await Promise.all(shown().map(({ id }) => readSamples(id, signals, range, POINTS)));
      if (mine !== asked) return;
      told = got;
      words.textContent = [...new Set(got.map(thinnedWords)), HOW_ZOOMED].join(" ");
      draw();
    } catch (error) {
      if (mine === asked) { words.textContent = /** @type {Error} */ (error).message; told = []; draw(); }
    }
  }

  /** What is shown, the one over it last. */
  function shown() {
    return [one, second].filter((recording) => recording !== null);
  }

  function draw() {
    canvas.hidden = told.length === 0;
    back.hidden = range === null;
    if (told.length === 0) return;
    const units = [...new Set(signals.map((name) => told[0].signals[name]?.unit ?? ""))];
    canvas.style.height = `${60 + PANEL_PX * units.length}px`;
    const colours = palette();
    const names = told.length < 2 ? [""] : shown().map((recording) => ` · ${nameOf(recording).replace(/[<>%]/g, " ")}`);
    const lines = [["second", "accent", "third", "ink"], ["over-1", "over-2", "over-3", "over-4"]];
    drawOn(canvas, told.flatMap((samples, k) => traces(samples, signals, units, lines[k].map((name) => colours[name]), names[k])),
      layout(units, marks, range === null ? [told[0].since, told[0].until] : [...range], colours), // its own: plotly changes it
      { ...STILL, doubleClick: "autosize" });
    canvas.setAttribute("aria-label", `${signals.join(", ")} from ${told[0].since} s to ${told[0].until} s`);
    listen();
  }

  function listen() {
    if (listening || !("on" in canvas)) return;
    listening = true;
    const plotted = /** @type {any} */ (canvas);
    plotted.on("plotly_relayout", (/** @type {Record<string, any>} */ change) => {
      const [from, to] = plotted.layout.xaxis.range;
      zoom(change["xaxis.autorange"] ? null : [Math.max(0, from), Math.max(0, to)]);
    });
    plotted.on("plotly_click", (/** @type {{points: {x: number}[]}} */ { points }) => listener(points[0].x));
  }

  let waiting = 0;
  /** @param {[number, number] | null} wanted */
  function zoom(wanted) {
    if (JSON.stringify(wanted) === JSON.stringify(range)) return;
    range = wanted;
    clearTimeout(waiting);
    waiting = setTimeout(ask, 150);
  }

  function choose() {
    const names = (one?.columns ?? []).filter((name) => !NOT_PLOTTED.includes(name));
    signals = names.filter((name) => USUAL.includes(name));
    if (signals.length === 0) signals = names.slice(0, 4);
    choices.replaceChildren(make("legend", { class: "visually-hidden" }, "Signals"), ...names.map((name) => {
      const box = /** @type {HTMLInputElement} */ (make("input", { type: "checkbox", name: "plotted", value: name, checked: signals.includes(name) }));
      box.addEventListener("change", () => {
        signals = names.filter((other) => (other === name ? box.checked : signals.includes(other)));
        ask();
      });
      return make("label", { class: "switch" }, box, make("span", {}, name));
    }));
  }

  back.addEventListener("click", () => zoom(null));
  copiesCsv(csv, "recording", () => columns(told[0], signals));

  return {
    root,
    /** @param {Recording | null} recording */
    show(recording) {
      root.hidden = recording === null;
      if (recording !== null && one !== null && recording.id === one.id) return draw();
      one = recording;
      range = null;
      choose();
      return ask();
    },
    /** @param {Recording | null} recording */
    over(recording) {
      if (recording?.id === second?.id) return;
      second = recording;
      if (one !== null) ask();
    },
    /** Reads what could not be read. */
    again() {
      if (told.length === 0) ask();
    },
    /** @param {Mark[]} now */
    marks(now) {
      marks = now;
    },
    /** @param {number} t */
    lookAt(t) {
      const length = range === null ? Math.min(1, (one?.seconds ?? 10) / 10) : range[1] - range[0];
      zoom([Math.max(0, t - length / 2), t + length / 2]);
    },
    /** @param {(t: number) => void} wanted is told the time where the plot was clicked */
    onTime(wanted) {
      listener = wanted;
    },
  };
}

/** @param {Samples} samples */
function thinnedWords({ rows, thinned, t }) {
  return thinned ? `${rows.toLocaleString("en").replace(/,/g, "\u202f")} rows as ${t.length} points with their extremes: zoom in to see each.`
    : "Every row is shown.";
}

/**
 * @param {Samples} samples
 * @param {string[]} signals
 * @param {string[]} units
 * @param {string[]} colours of the signals of a unit
 * @param {string} of what follows each name
 */
function traces(samples, signals, units, colours, of) {
  /** @type {Map<string, number>} */
  const used = new Map();
  return signals.flatMap((name) => {
    const spread = samples.signals[name];
    if (spread === undefined) return [];
    const place = units.indexOf(spread.unit);
    if (place < 0) return [];
    const nth = used.get(spread.unit) ?? 0;
    used.set(spread.unit, nth + 1);
    const both = samples.thinned;
    return [{
      x: both ? samples.t.flatMap((t) => [t, t]) : samples.t,
      y: both ? samples.t.flatMap((_, k) => [spread.low[k], spread.high[k]]) : spread.mean,
      type: "scatter", mode: "lines", name: `${name}${of}`, xaxis: "x", yaxis: `y${place === 0 ? "" : place + 1}`,
      line: { color: colours[nth % colours.length], width: nth === 0 ? 2 : 1.2 }, // seen where another lies over it
      hovertemplate: `${name}${of} %{y:.5g} ${spread.unit}, %{x:.5g} s<extra></extra>`,
    }];
  });
}

/**
 * @param {string[]} units
 * @param {Mark[]} marks
 * @param {[number, number]} range
 * @param {Record<string, string>} colours
 */
function layout(units, marks, range, colours) {
  const axis = axisOf(colours);
  const share = 1 / units.length;
  return {
    ...baseLayout(colours),
    ...Object.fromEntries(units.map((unit, place) => [`yaxis${place === 0 ? "" : place + 1}`, {
      ...axis, title: { text: unit, standoff: 4 }, nticks: 6, fixedrange: true,
      domain: [1 - (place + 1) * share + 0.02, 1 - place * share - (place === 0 ? 0 : 0.02)],
    }])),
    margin: { l: 66, r: 14, t: 26, b: 40 }, hovermode: "closest", dragmode: "zoom", showlegend: true,
    legend: { orientation: "h", x: 0, xanchor: "left", y: 1.01, yanchor: "bottom" },
    xaxis: { ...axis, range, anchor: `y${units.length === 1 ? "" : units.length}`, title: { text: "time from the begin, s", standoff: 6 } },
    shapes: marks.map(({ t }) => ({ type: "line", xref: "x", yref: "paper", x0: t, x1: t, y0: 0, y1: 1,
      line: { color: colours.ink, width: 1, dash: "dash" } })),
    annotations: marks.map(({ t, text }) => ({ x: t, y: 1, xref: "x", yref: "paper", yanchor: "top", xanchor: "left",
      text: text.replace(/</g, "&lt;"), showarrow: false, bgcolor: colours.surface, font: { color: colours.ink, size: 11 } })),
  };
}

/** @param {Samples | undefined} samples @param {string[]} signals */
function columns(samples, signals) {
  /** @type {Record<string, (number | null)[]>} */
  const made = { "t [s]": samples?.t ?? [] };
  for (const name of signals) {
    const spread = samples?.signals[name];
    if (samples === undefined || spread === undefined) continue;
    if (samples.thinned) {
      made[`${name}_low [${spread.unit}]`] = spread.low;
      made[`${name}_high [${spread.unit}]`] = spread.high;
    } else made[`${name} [${spread.unit}]`] = spread.mean;
  }
  return made;
}
