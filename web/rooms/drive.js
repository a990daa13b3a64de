/**
 * The room of the drive: all its signals with units and limits and what has changed since they were looked at last,
 * and what has happened to it: events, who wrote what, who controlled it.
 *
 * @typedef {{name: string, value: number | null, unit: string, access: "const" | "ro" | "rw", minimum: number | null,
 *   maximum: number | null, summary: string}} Signal
 * @typedef {import("../api.js").DriveEvent} DriveEvent
 */

import { listEvents, readAllSignals } from "../api.js";
import { make } from "../dom.js";
import { element } from "../fields.js";
import { clock, plain } from "../format.js";
import { unitShown } from "./quantity.js";

const EVENTS_MS = 2000;
const GROUPS = /** @type {const} */ ([["rw", "Settings"], ["ro", "What it tells"], ["const", "What it is"]]);
const KINDS = [["", "everything"], ["link", "link"], ["state", "states"], ["fault", "faults"], ["write", "writes"], ["lease", "control"]];

/** @returns {import("../main.js").RoomPart} */
export function driveRoom() {
  const filter = /** @type {HTMLInputElement} */ (make("input", { id: "signals-filter", class: "text", type: "search",
    placeholder: "name or meaning", "aria-label": "Search signals" }));
  const again = make("button", { type: "button", id: "signals-read" }, "Read again");
  const looked = make("p", { id: "signals-looked", class: "section-note", role: "status" });
  const tables = make("div", { id: "signals" });
  const kind = /** @type {HTMLSelectElement} */ (make("select", { id: "events-kind", "aria-label": "Kind" },
    KINDS.map(([value, words]) => make("option", { value }, words))));
  const events = make("ul", { id: "events", class: "events" });
  const eventsNote = make("p", { class: "section-note", id: "events-note", role: "status" });
  const older = make("button", { type: "button", id: "events-more", hidden: true }, "Older ones");

  element("drive-room").append(
    make("section", { class: "card padded", "aria-labelledby": "signals-title-2" },
      make("div", { class: "section-head" }, make("h2", { id: "signals-title-2" }, "Signals"), looked),
      make("div", { class: "filters" }, filter, again), tables),
    make("section", { class: "card padded", "aria-labelledby": "events-title" },
      make("div", { class: "section-head" }, make("h2", { id: "events-title" }, "What has happened"), eventsNote),
      make("div", { class: "filters" }, kind), events, older));

  let drive = "";
  let timer = 0;
  /** @type {Signal[]} */
  let signals = [];
  /** Values when they were looked at last, and when that was. @type {{at: string, values: Record<string, number | null>} | null} */
  let before = null;
  /** @type {DriveEvent[]} */
  let past = [];
  /** @type {string | null} */
  let next = null;
  let key = "";

  const place = () => `pmsm-bench signals ${drive}`;

  async function read() {
    const asked = drive;
    looked.textContent = "Reading …";
    try {
      const told = await readAllSignals(asked);
      if (asked !== drive) return;
      signals = told;
      looked.textContent = `Read ${clock(new Date())}.` + (before === null ? "" : ` Compared with ${clock(before.at)}, when they were looked at last.`);
      show();
    } catch (error) {
      if (asked === drive) looked.textContent = /** @type {Error} */ (error).message;
    }
  }

  function show() {
    const text = filter.value.trim().toLowerCase();
    const fits = signals.filter(({ name, summary }) => `${name} ${summary}`.toLowerCase().includes(text));
    tables.replaceChildren(...GROUPS.flatMap(([access, title]) => {
      const rows = fits.filter((signal) => signal.access === access);
      return rows.length === 0 ? [] : [make("h3", {}, title), make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": title }, make("table", {},
        make("thead", {}, make("tr", {}, ["signal", "value", "limits", "what it is"].map((head, k) => make("th", { class: k === 1 && "n", scope: "col" }, head)))),
        make("tbody", {}, rows.map(row))))];
    }), ...(fits.length === 0 && signals.length > 0 ? [make("p", { class: "empty" }, "No signal fits the search.")] : []));
  }

  /** @param {Signal} signal */
  function row({ name, value, unit, access, minimum, maximum, summary }) {
    const was = access === "rw" ? before?.values[name] : undefined;
    const changed = was !== undefined && was !== value;
    const shown = (/** @type {number | null} */ number) => (number === null ? "not known" : `${plain(number, 6).replace("-", "−")} ${unitShown(unit)}`.trim());
    const limits = access !== "rw" || (minimum === null && maximum === null) ? ""
      : `${minimum === null ? "" : plain(minimum, 4)} … ${maximum === null ? "" : plain(maximum, 4)}`;
    return make("tr", { class: changed && "changed" }, make("td", {}, make("code", {}, name)),
      make("td", { class: "n" }, shown(value), changed && make("span", { class: "chip warn" }, `was ${shown(was)}`)),
      make("td", {}, limits), make("td", {}, summary));
  }

  async function refreshEvents() {
    const asked = drive;
    try {
      const page = await listEvents(asked, kind.value);
      if (asked !== drive) return;
      if (past.length === 0) next = page.next;
      const all = [...page.events, ...past];
      const now = JSON.stringify(all);
      if (now === key) return;
      key = now;
      eventsNote.textContent = all.length === 0 ? "Nothing yet: what happens to the drive, and who writes to it, is told here." : `${page.total}, the newest first.`;
      events.replaceChildren(...all.map(({ at, kind: what, sentence, write, lease }) => make("li", {},
        make("time", { datetime: at }, clock(at)), make("span", { class: "chip" }, what),
        make("span", {}, sentence, changes(write), lease !== null && lease.ended !== null && make("span", { class: "unit" }, ` · until ${clock(lease.ended)}, ${lease.how}`)))));
      older.hidden = next === null;
    } catch (error) {
      if (asked === drive) eventsNote.textContent = /** @type {Error} */ (error).message;
    }
  }

  function restart() {
    past = [];
    next = null;
    refreshEvents();
  }

  filter.addEventListener("input", show);
  again.addEventListener("click", read);
  kind.addEventListener("change", restart);
  older.addEventListener("click", async () => {
    if (next === null) return;
    const page = await listEvents(drive, kind.value, next);
    past.push(...page.events);
    next = page.next;
    refreshEvents();
  });

  return {
    enter(name) {
      drive = name;
      signals = [];
      key = "";
      before = remembered(place());
      tables.replaceChildren();
      clearInterval(timer);
      timer = setInterval(() => { if (!document.hidden) refreshEvents(); }, EVENTS_MS);
      read();
      restart();
    },
    leave() {
      clearInterval(timer);
      if (signals.length === 0) return;
      const values = Object.fromEntries(signals.filter(({ access }) => access === "rw").map(({ name, value }) => [name, value]));
      try { localStorage.setItem(place(), JSON.stringify({ at: new Date().toISOString(), values })); } catch { /* no room for it */ }
    },
  };
}

/** What a write changed. @param {DriveEvent["write"]} write */
function changes(write) {
  const { before, after } = write ?? {};
  if (!before || !after) return null;
  const told = Object.keys(after).map((name) => `${name} ${shown(before[name])} → ${shown(after[name])}`);
  return told.length === 0 ? null : make("span", { class: "unit" }, ` · ${told.join(", ")}`);
}

/** @param {unknown} value */
function shown(value) {
  return typeof value === "number" ? plain(value, 6) : typeof value === "object" ? JSON.stringify(value) : String(value ?? "–");
}

/** @param {string} place @returns {{at: string, values: Record<string, number | null>} | null} */
function remembered(place) {
  try {
    return JSON.parse(localStorage.getItem(place) ?? "null");
  } catch {
    return null;
  }
}
