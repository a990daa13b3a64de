/**
 * The drive's parameters: its present values, a set of others - typed here, from a file, or of a commissioning -, the plan
 * of what that would change, and the flash.
 *
 * @typedef {import("../api.js").DriveState} DriveState
 * @typedef {import("../api.js").ParameterEntry} ParameterEntry
 * @typedef {import("../api.js").Plan} Plan
 * @typedef {import("./signals_view.js").Signal} Signal
 */

import { askFlash, parameterFile, planSet, readParameterSet } from "../api.js";
import { confirmed } from "../dialog.js";
import { make } from "../dom.js";
import { number, write } from "../fields.js";
import { clock, counted, exact, kindOfJob } from "../format.js";
import { commissioningView } from "./commissioning_view.js";
import { flashView } from "./flash_view.js";
import { DIGITS, planElements, planWords, tableOf } from "./plan_view.js";
import { unitShown } from "./quantity.js";

const ON = "operation enabled";
const ROW = 8;

export function parametersView() {
  const filter = /** @type {HTMLInputElement} */ (make("input", { id: "parameters-filter", class: "text", type: "search",
    placeholder: "name or meaning", "aria-label": "Search parameters" }));
  const looked = make("p", { id: "parameters-looked", class: "section-note", role: "status" });
  const again = make("button", { type: "button", id: "parameters-read", onclick: read }, "Read again");
  const download = make("a", { id: "parameters-download", download: true }, "Download as TOML");
  const file = /** @type {HTMLInputElement} */ (make("input", { id: "parameters-file", type: "file", accept: ".toml" }));
  const values = make("div", { id: "parameters" });
  const given = make("p", { id: "set-words" });
  const plan_ = /** @type {HTMLButtonElement} */ (make("button", { type: "button", id: "set-plan", onclick: plan }, "Plan"));
  const planWhy = make("span", { class: "hint", id: "set-plan-why" });
  const discard = make("button", { type: "button", id: "set-discard", onclick: () => forget() }, "Discard");
  const planned = make("div", { id: "plan", class: "planned" });
  const reason = /** @type {HTMLInputElement} */ (make("input", { id: "flash-reason", class: "text", maxlength: 200, placeholder: "why it is flashed all the same" }));
  const reasonField = make("div", { class: "field", hidden: true }, make("label", { for: "flash-reason" }, "Reason, which the history keeps"), make("div", { class: "entry" }, reason));
  const flash = /** @type {HTMLButtonElement} */ (make("button", { type: "button", id: "flash-start", class: "primary", onclick: ask }, "Flash …"));
  const flashWhy = make("span", { class: "hint", id: "flash-why" });
  const message = make("p", { id: "parameters-message", class: "form-message", role: "alert" });
  const flashes = flashView(() => { forget(); read(); });
  const commissioning = commissioningView(propose, () => { dropPlan(); showSet(); read(); });
  const root = make("section", { class: "card padded parameters", "aria-labelledby": "parameters-title" },
    make("div", { class: "section-head" }, make("h2", { id: "parameters-title" }, "Parameters"), looked),
    flashes.cut, commissioning.root,
    make("div", { class: "set" },
      make("p", { class: "entry" }, make("label", { for: "parameters-file" }, "A set from a file"), file), given,
      make("div", { class: "actions" }, plan_, discard, planWhy),
      planned, reasonField,
      make("div", { class: "actions" }, flash, flashWhy), message, flashes.now),
    flashes.history,
    make("h3", {}, "Present values"), make("div", { class: "filters" }, filter, again, download), values);

  let drive = "";
  /** As the drive has them. @type {Record<string, ParameterEntry>} */
  let present = {};
  /** What they are, as the signals tell. @type {Map<string, Signal>} */
  let meanings = new Map();
  /** Typed here, SI. @type {Map<string, number>} */
  let typed = new Map();
  /** @type {{name: string, text: string} | null} */
  let chosen = null;
  /** The one whose value is being typed. */
  let edited = "";
  /** @type {Plan | null} */
  let made = null;
  /** Why nothing can be flashed now; empty: it can. */
  let hindered = "";
  /** Why nothing can be planned now; empty: it can. */
  let held = "";
  let asking = false;
  /** Counts plans, and those that were dropped: the latest alone is shown. */
  let turn = 0;
  /** Whether the values could not be read, and whether there was a link to read them by. */
  let unread = false;
  let linked = false;

  async function read() {
    const asked = drive;
    write(looked, "Reading …");
    try {
      const set = await readParameterSet(asked);
      if (asked !== drive) return;
      present = set.entries;
      unread = false;
      write(looked, `${counted(Object.keys(present).length, "value", "values")}, read ${clock(new Date())}.`);
      show();
    } catch (error) {
      if (asked !== drive) return;
      unread = true;
      write(looked, /** @type {Error} */ (error).message);
    }
  }

  function show() {
    const text = filter.value.trim().toLowerCase();
    const names = Object.keys(present).filter((name) => `${name} ${meanings.get(name)?.summary ?? ""}`.toLowerCase().includes(text));
    const scalars = names.filter((name) => tableOf(name) === null);
    const tables = [...new Set(Object.keys(present).map(tableOf).filter((name) => name !== null))].filter((name) => name.includes(text));
    values.replaceChildren(
      ...(scalars.length === 0 ? [] : [make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Present values" }, make("table", {},
        make("thead", {}, make("tr", {}, ["parameter", "value", "what it is"].map((head, k) => make("th", { class: k === 1 && "n", scope: "col" }, head)))),
        make("tbody", {}, scalars.map(row))))]),
      ...tables.map(table),
      ...(scalars.length + tables.length === 0 && Object.keys(present).length > 0 ? [make("p", { class: "empty" }, "No parameter fits the search.")] : []));
    showSet();
  }

  /** @param {string} name */
  function row(name) {
    const { value, unit } = present[name];
    const then = typed.get(name);
    return make("tr", { class: then !== undefined && "changed" }, make("td", {}, make("code", {}, name)),
      make("td", { class: "n" }, ...(edited === name ? [entry(name)] : [`${exact(value, DIGITS)} ${unitShown(unit)}`.trim(),
        then !== undefined && make("span", { class: "chip warn" }, `to be ${exact(then, DIGITS)}`),
        make("button", { type: "button", class: "small edit", "aria-label": `Set ${name}`, onclick: () => edit(name) }, "Set")])),
      make("td", {}, meanings.get(name)?.summary ?? ""));
  }

  /** @param {string} name */
  function table(name) {
    const entries = Object.entries(present).filter(([one]) => tableOf(one) === name).map(([, one]) => one);
    const rows = Array.from({ length: Math.ceil(entries.length / ROW) }, (_, k) => entries.slice(ROW * k, ROW * (k + 1)));
    return make("details", { class: "fold" }, make("summary", {}, make("code", {}, name), `: ${entries.length} entries${entries[0] ? `, ${unitShown(entries[0].unit)}` : ""}`),
      make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": `Table ${name}` }, make("table", {}, make("tbody", {},
        rows.map((each) => make("tr", {}, each.map(({ value }) => make("td", { class: "n" }, exact(value, 4)))))))),
      make("p", { class: "help" }, "Entries come by a file: download the set, edit it, and choose it above."));
  }

  /** @param {string} name empty: none */
  function edit(name) {
    edited = name;
    show();
    values.querySelector("input")?.select();
  }

  /** @param {string} name */
  function entry(name) {
    const { value, unit } = present[name];
    const field = /** @type {HTMLInputElement} */ (make("input", { inputmode: "decimal", "aria-label": name, value: exact(typed.get(name) ?? value, DIGITS) }));
    return make("form", { class: "entry", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); take(name, field); } },
      field, make("span", { class: "unit" }, unitShown(unit)), make("button", { type: "submit", class: "small primary" }, "Set"),
      make("button", { type: "button", class: "small", onclick: () => edit("") }, "Cancel"));
  }

  /** @param {string} name @param {HTMLInputElement} field */
  function take(name, field) {
    try {
      const wanted = number(field, name);
      chosen = null;
      file.value = "";
      if (wanted === present[name].value) typed.delete(name);
      else typed.set(name, wanted);
      say("");
      dropPlan();
      edit("");
    } catch (error) {
      say(/** @type {Error} */ (error).message, "bad");
    }
  }

  async function take_file() {
    const one = file.files?.[0];
    if (one === undefined) return forget();
    choose({ name: one.name, text: await one.text() });
  }

  /** What a commissioning proposes. @param {string} name @param {string} text */
  function propose(name, text) {
    file.value = "";
    choose({ name, text });
    given.scrollIntoView({ block: "center" });
  }

  /** @param {{name: string, text: string}} set */
  function choose(set) {
    typed.clear();
    chosen = set;
    dropPlan();
    say("");
    edit("");
    if (held === "") plan();
  }

  function dropPlan() {
    turn += 1;
    made = null;
    reason.value = "";
    reasonField.hidden = true;
    planned.replaceChildren();
  }

  function forget() {
    typed.clear();
    chosen = null;
    file.value = "";
    dropPlan();
    edit("");
  }

  /** As the service takes it: a file's text as it is. */
  function set() {
    if (chosen !== null) return chosen.text;
    return { name: "by hand", entries: Object.fromEntries([...typed].map(([name, value]) => [name, { value, source: "typed on the page" }])) };
  }

  function showSet() {
    const some = chosen !== null || typed.size > 0;
    write(given, chosen !== null ? `${chosen.name} is to be planned, then flashed.`
      : typed.size > 0 ? `By hand: ${[...typed.keys()].join(", ")}.` : "No other values yet: set some below, or choose a file.");
    plan_.disabled = !some || asking || held !== "";
    discard.hidden = !some;
    write(planWhy, some ? held : "There is nothing to plan yet.");
    enable();
  }

  async function plan() {
    dropPlan();
    const mine = turn;
    flashes.quiet();
    await tried(async () => {
      const told = await planSet(drive, set());
      if (mine !== turn) return;
      made = told;
      planned.replaceChildren(...planElements(told));
      reasonField.hidden = told.doubts.length === 0;
    });
  }

  async function ask() {
    const asked = drive;
    const plan = made;
    if (plan === null) return;
    const name = chosen?.name ?? "what was typed";
    const sure = await confirmed(`Flash ${name} into ${asked}?`,
      `${planWords(plan)} They are stored in the drive, which is reset: its stream breaks off for a moment. What does not come out is rolled back.`, `Flash ${asked}`);
    if (!sure || asked !== drive) return;
    await tried(async () => { flashes.follow(await askFlash(asked, set(), reason.value.trim())); });
  }

  /** @param {() => Promise<void>} what */
  async function tried(what) {
    say("");
    asking = true;
    showSet();
    try {
      await what();
    } catch (error) {
      say(/** @type {Error} */ (error).message, "bad");
    }
    asking = false;
    showSet();
  }

  function enable() {
    const why = hindered !== "" ? hindered : made === null ? "Plan it first." : made.problems.length > 0 ? "What forbids it stands above."
      : made.changes.length === 0 ? "Nothing would change."
      : made.doubts.length > 0 && reason.value.trim() === "" ? "The doubts ask for a reason." : asking ? "It is asked for." : "";
    flash.disabled = why !== "";
    write(flashWhy, why);
  }

  /** @param {string} text @param {string} [mood] */
  function say(text, mood = "") {
    message.dataset.mood = mood;
    message.textContent = text;
  }

  filter.addEventListener("input", show);
  reason.addEventListener("input", enable);
  file.addEventListener("change", take_file);

  return {
    root,
    /** @param {Signal[]} signals */
    explain(signals) {
      meanings = new Map(signals.map((signal) => [signal.name, signal]));
      if (edited === "") show();
    },
    /** @param {DriveState} now @param {boolean} connected */
    show(now, connected) {
      const before = linked;
      linked = connected && now.link.state === "streaming";
      if (linked && !before && unread) read();
      hindered = whyNot(now, connected);
      held = whyHeld(now);
      flashes.hinder(hindered);
      commissioning.show(now, hindered);
      showSet();
    },
    /** @param {string} name */
    enter(name) {
      drive = name;
      present = {};
      hindered = held = "";
      unread = linked = false;
      download.setAttribute("href", parameterFile(name, "toml"));
      forget();
      say("");
      flashes.enter(name);
      commissioning.enter(name);
      read();
    },
    leave() {
      flashes.leave();
      commissioning.leave();
    },
  };
}

/** Why nothing can be planned for a drive now, a sentence; empty where it can. @param {DriveState} now */
function whyHeld({ control }) {
  return control.in_experiment ? `The ${kindOfJob(control.whom)} is under way: the drive has the settings of a trial.` : "";
}

/** Why a drive cannot be flashed now, a sentence; empty where it can. @param {DriveState} now @param {boolean} connected */
function whyNot({ link, control, writer, cut_flash }, connected) {
  if (!connected) return "The service is not heard.";
  if (control.in_flash) return "A flash is under way.";
  if (link.state !== "streaming" || control.state === null) return "There is no link to the drive.";
  if (cut_flash !== null) return "A flash was cut: finish it, or roll it back, first.";
  if (control.in_experiment) return `The ${kindOfJob(control.whom)} is under way: stop it first.`;
  if (control.state === ON) return "The drive is on: stop it first.";
  if (control.holder !== null) return `${control.holder} controls the drive: stop it first.`;
  return writer === null ? "" : `${writer.holder} is at the drive.`;
}
