/**
 * One recording: what it is, its plot with another one over it, its marks, and what can be done with it.
 *
 * @typedef {import("../api.js").Recording} Recording
 */

import { annotateRecording, deleteRecording, endRecording, markRecording, readRecording, recordingFile } from "../api.js";
import { onHeardAgain } from "../connection.js";
import { confirmed } from "../dialog.js";
import { make } from "../dom.js";
import { bytes, clock, duration, integer, parseNumber } from "../format.js";
import { go } from "../router.js";
import { diagnoseIt, lacking } from "./diagnose_it.js";
import { nameOf } from "./recording_name.js";
import { recordingPlot } from "./recording_plot.js";

const FORMATS = [["parquet", "Parquet"], ["csv", "CSV"], ["mat", "MATLAB"], ["mf4", "MDF4"]];
const UNDER_WAY = ["armed", "recording", "closing"];

export function recordingView() {
  const root = make("section", { class: "card padded view", id: "recording-view", "aria-label": "The recording that is chosen" });
  const plot = recordingPlot();
  let drive = "";
  /** @type {string | null} */
  let id = null;
  /** @type {Recording | null} */
  let one = null;
  let key = "";
  /** @type {Recording[]} */
  let others = [];

  const heading = make("h2", { id: "recording-heading" });
  const facts = make("dl", { class: "facts" });
  const reason = make("p", { class: "section-note", id: "recording-reason" });
  const message = make("p", { class: "form-message", id: "recording-message", role: "alert" });
  const actions = make("div", { class: "actions" });
  const marks = make("ul", { class: "marks", id: "recording-marks" });
  const markAt = /** @type {HTMLInputElement} */ (make("input", { id: "mark-t", inputmode: "decimal", "aria-label": "Time of the mark in s from the begin" }));
  const markText = /** @type {HTMLInputElement} */ (make("input", { id: "mark-text", class: "text", placeholder: "what happened", "aria-label": "What to mark", maxlength: 200 }));
  const title = /** @type {HTMLInputElement} */ (make("input", { id: "recording-title", class: "text", maxlength: 200, "aria-label": "Title" }));
  const note = /** @type {HTMLTextAreaElement} */ (make("textarea", { id: "recording-note", rows: 2, maxlength: 4000, "aria-label": "Note" }));
  const over = /** @type {HTMLSelectElement} */ (make("select", { id: "recording-over", "aria-label": "Another recording over this one" }));
  over.addEventListener("change", () => plot.over(others.find((other) => other.id === over.value) ?? null));
  plot.onTime((t) => { markAt.value = t.toFixed(4); });

  const whole = make("div", { hidden: true },
    heading, facts, reason, actions, message,
    make("p", { class: "entry" }, make("label", { for: "recording-over" }, "Over it"), over),
    plot.root,
    make("h3", {}, "Marks"), marks,
    make("form", { class: "entry", id: "mark-form", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); mark(); } },
      make("span", { class: "unit" }, "at"), markAt, make("span", { class: "unit" }, "s"), markText,
      make("button", { type: "submit" }, "Mark")),
    make("h3", {}, "Title and note"),
    make("form", { class: "annotation", id: "annotation-form", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); annotate(); } },
      title, note, make("div", { class: "actions" }, make("button", { type: "submit" }, "Save"))));
  const nothing = make("p", { class: "empty" }, "Choose a recording in the list: its signals are plotted here.");
  root.append(nothing, whole);

  /** @param {string} text @param {boolean} [bad] */
  function say(text, bad = true) {
    message.dataset.mood = text === "" ? "" : bad ? "bad" : "good";
    message.textContent = text;
  }

  /** @param {() => Promise<unknown>} what */
  async function tried(what) {
    try {
      say("");
      await what();
    } catch (error) {
      say(/** @type {Error} */ (error).message);
    }
    await refresh();
  }

  function mark() {
    const t = parseNumber(markAt.value);
    const name = id ?? "";
    if (t === null) return say(`Time of the mark: expected a number of s from the begin, got “${markAt.value}”.`);
    return tried(async () => { await markRecording(name, markText.value.trim() || "mark", t); markText.value = ""; });
  }

  function annotate() {
    const name = id ?? "";
    tried(async () => { await annotateRecording(name, { title: title.value.trim(), note: note.value.trim() }); say("Saved.", false); });
  }

  async function remove() {
    if (one === null) return;
    const gone = one;
    const sure = await confirmed(`Delete ${gone.title || gone.id}?`,
      `${gone.id}: ${gone.kind} of ${clock(gone.begun)}, ${integer(gone.rows)} rows, ${bytes(gone.bytes)}. It goes from the disk for good.`, "Delete it");
    if (!sure) return;
    await tried(async () => {
      await deleteRecording(gone.id);
      id = one = null; // there is nothing to look at again
      go("recordings", drive);
    });
  }

  async function refresh() {
    if (id === null) return;
    const asked = id;
    try {
      const told = await readRecording(asked);
      if (asked === id) fill(told);
    } catch (error) {
      if (asked === id) say(/** @type {Error} */ (error).message);
    }
  }

  /** @param {Recording} told */
  function fill(told) {
    const first = one === null || one.id !== told.id;
    const now = JSON.stringify(told);
    if (now === key) return;
    key = now;
    one = told;
    whole.hidden = false;
    nothing.hidden = true;
    heading.textContent = nameOf(told);
    const running = UNDER_WAY.includes(told.state);
    facts.replaceChildren(...factsOf(told).map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
    reason.textContent = told.reason === "" ? "" : `${told.reason.charAt(0).toUpperCase()}${told.reason.slice(1)}${told.reason.endsWith(".") ? "" : "."}`;
    actions.replaceChildren(...(running
      ? [make("button", { type: "button", class: "primary", onclick: () => tried(() => endRecording(told.id)) }, "End the recording")]
      : [
        ...diagnoseLink(told),
        make("span", { class: "exports" }, "Export: ", ...FORMATS.map(([format, words]) =>
          make("a", { class: "small", href: recordingFile(told.id, format), download: true }, words))),
        make("button", { type: "button", id: "recording-delete", class: "danger", onclick: remove }, "Delete …"),
      ]));
    marks.replaceChildren(...(told.marks.length === 0
      ? [make("li", { class: "empty" }, running ? "None yet." : "None yet. Click into the plot for a time, say what happened, and Mark.")]
      : told.marks.map(({ t, text, whom }) => make("li", {},
        make("button", { type: "button", class: "small", onclick: () => plot.lookAt(t) }, `${t.toFixed(3)} s`), ` ${text}`,
        whom !== "" && make("span", { class: "unit" }, ` · ${whom}`)))));
    if (first || document.activeElement !== title) title.value = told.title;
    if (first || document.activeElement !== note) note.value = told.note;
    plot.marks(told.marks);
    if (running) plot.show(null);
    else plot.show(told);
    offerOthers();
  }

  /** @param {Recording} told */
  function diagnoseLink(told) {
    if (told.kind === "stream") return [make("span", { class: "unit" }, "A stream's rows cover several control periods: capture to diagnose.")];
    const without = lacking(told);
    if (without.length > 0) return [make("span", { class: "unit" }, `It cannot be diagnosed: it lacks ${without.join(", ")}.`)];
    return [make("button", { type: "button", class: "primary", id: "recording-diagnose", onclick: () => tried(() => diagnoseIt(told.id, drive)) }, "Diagnose it")];
  }

  function offerOthers() {
    const wanted = others.filter((other) => other.id !== id && other.state === "done");
    const before = over.value;
    over.replaceChildren(make("option", { value: "" }, "nothing"),
      ...wanted.map((other) => make("option", { value: other.id }, nameOf(other))));
    over.value = wanted.some((other) => other.id === before) ? before : "";
  }

  onHeardAgain(() => {
    say("");
    refresh();
    plot.again();
  });

  return {
    root,
    /** @param {string | null} wanted @param {string} name */
    show(wanted, name) {
      drive = name;
      if (wanted === id && one !== null) { refresh(); return; }
      id = wanted;
      one = null;
      key = "";
      over.value = "";
      plot.over(null);
      plot.show(null);
      say("");
      whole.hidden = true;
      nothing.hidden = id !== null;
      refresh();
    },
    refresh() {
      if (one !== null && UNDER_WAY.includes(one.state)) refresh();
    },
    /** @param {Recording[]} recordings that are in the list */
    offer(recordings) {
      others = recordings;
      if (document.activeElement !== over) offerOthers();
    },
  };
}

/** @param {Recording} told @returns {[string, string][]} */
function factsOf(told) {
  return [
    ["Name", told.id],
    ["Kind", told.kind + (told.drive === "" ? "" : ` of ${told.drive}`)],
    ["Begun", clock(told.begun)],
    ["Length", told.seconds === null ? "–" : duration(told.seconds)],
    ["Rows", integer(told.rows)],
    ["On disk", bytes(told.bytes)],
    ["Gaps", told.gaps === 0 ? "none" : `${told.gaps}, ${integer(told.rows_lost)} rows lost`],
  ];
}
