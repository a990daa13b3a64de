/**
 * The room of the drive: its parameters, its signals, and what has happened to it: events, who wrote what, who controlled
 * it.
 *
 * @typedef {import("../api.js").DriveEvent} DriveEvent
 */

import { listEvents } from "../api.js";
import { make } from "../dom.js";
import { element } from "../fields.js";
import { clock, exact } from "../format.js";
import { parametersView } from "./parameters_view.js";
import { signalsView } from "./signals_view.js";

const EVENTS_MS = 2000;
const KINDS = [["", "everything"], ["link", "link"], ["state", "states"], ["fault", "faults"], ["flash", "flashes"], ["write", "writes"], ["lease", "control"]];

/** @returns {import("../main.js").RoomPart} */
export function driveRoom() {
  const parameters = parametersView();
  const signals = signalsView(parameters.explain);
  const kind = /** @type {HTMLSelectElement} */ (make("select", { id: "events-kind", "aria-label": "Kind" },
    KINDS.map(([value, words]) => make("option", { value }, words))));
  const events = make("ul", { id: "events", class: "events" });
  const eventsNote = make("p", { class: "section-note", id: "events-note", role: "status" });
  const older = make("button", { type: "button", id: "events-more", hidden: true }, "Older ones");

  element("drive-room").append(
    parameters.root,
    make("section", { class: "card padded happened", "aria-labelledby": "events-title" },
      make("div", { class: "section-head" }, make("h2", { id: "events-title" }, "What has happened"), eventsNote),
      make("div", { class: "filters" }, kind), events, older),
    signals.root);

  let drive = "";
  let timer = 0;
  /** @type {DriveEvent[]} */
  let past = [];
  /** @type {string | null} */
  let next = null;
  let key = "";

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
        make("span", {}, sentence, changes(write), lease !== null && lease.ended !== null && make("span", { class: "unit" }, ` · until ${clock(lease.ended)}`)))));
      older.hidden = next === null;
    } catch (error) {
      key = "";
      if (asked === drive) eventsNote.textContent = /** @type {Error} */ (error).message;
    }
  }

  function restart() {
    past = [];
    next = null;
    refreshEvents();
  }

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
      key = "";
      parameters.enter(name);
      signals.enter(name);
      clearInterval(timer);
      timer = setInterval(() => { if (!document.hidden) refreshEvents(); }, EVENTS_MS);
      restart();
    },
    show: parameters.show,
    leave() {
      clearInterval(timer);
      parameters.leave();
      signals.leave();
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
  return typeof value === "number" ? exact(value, 6) : value === null || value === undefined ? "none" : typeof value === "object" ? JSON.stringify(value) : String(value);
}
