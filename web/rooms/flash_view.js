/**
 * Flashes of the drive: one under way with its steps and how it ended, one that was cut with what can be done about it,
 * and those of the past with a way back.
 *
 * @typedef {import("../api.js").Flash} Flash
 * @typedef {import("../api.js").CutFlash} CutFlash
 * @typedef {import("../api.js").PastFlash} PastFlash
 */

import { askResume, askRollback, listFlashes, planRollback, readFlash } from "../api.js";
import { confirmed } from "../dialog.js";
import { make } from "../dom.js";
import { write } from "../fields.js";
import { clock, counted, exact } from "../format.js";
import { DIGITS, planWords, tableOf } from "./plan_view.js";
import { sentenceCase, unitShown } from "./quantity.js";

const POLL_MS = 250;
const REFRESH_MS = 3000;
const NAMED = 6;
const MOODS = { flashed: "good", "rolled back": "warn", cut: "bad", running: "" };

/** @param {() => void} ended is called when the drive may have other values */
export function flashView(ended) {
  const bar = /** @type {HTMLProgressElement} */ (make("progress", { max: 1, value: 0, "aria-label": "progress of the flash" }));
  const phase = make("p", { id: "flash-phase", class: "phase", role: "status" });
  const steps = make("ol", { class: "steps", id: "flash-steps" });
  const verdict = make("p", { id: "flash-verdict", class: "form-message", role: "status" });
  const now = make("div", { id: "flash-now", hidden: true }, bar, phase, steps, verdict);
  const cutWords = make("p", { id: "cut-words" });
  const finish = button("cut-finish", "Finish it", () => resume(true));
  const back = button("cut-roll-back", "Roll it back", () => resume(false));
  const cutWhy = make("span", { class: "hint", id: "cut-why" });
  const cut = make("div", { id: "cut", class: "cut", role: "alert", hidden: true }, cutWords, make("div", { class: "actions" }, finish, back, cutWhy));
  const rollback = button("flash-rollback", "Roll back the latest …", () => askBack());
  const rollbackWhy = make("span", { class: "hint", id: "flash-rollback-why" });
  const past = make("ul", { class: "events" });
  const pastBox = make("div", { id: "flash-history", tabindex: 0, role: "region", "aria-label": "What was flashed" }, past);
  const note = make("p", { class: "section-note", id: "flash-note", role: "status" });
  const message = make("p", { class: "form-message", id: "flash-message", role: "alert" });
  const history = make("div", {}, make("div", { class: "section-head" }, make("h3", {}, "Flashed"), note),
    make("div", { class: "actions" }, rollback, rollbackWhy), message, pastBox);

  let drive = "";
  let timer = 0;
  let following = "";
  let key = "";
  /** Why nothing can be flashed now; empty: it can. */
  let hindered = "";
  let others = 0;

  /** @param {string} id @param {string} words @param {() => void} onclick */
  function button(id, words, onclick) {
    return /** @type {HTMLButtonElement} */ (make("button", { type: "button", id, onclick }, words));
  }

  /** @param {() => Promise<unknown>} what */
  async function tried(what) {
    message.textContent = "";
    try {
      await what();
    } catch (error) {
      message.dataset.mood = "bad";
      message.textContent = /** @type {Error} */ (error).message;
    }
  }

  async function refresh() {
    const asked = drive;
    try {
      const told = await listFlashes(asked);
      if (asked !== drive) return;
      const running = told.flashes.find(({ state }) => state === "running");
      if (running !== undefined) follow(running);
      others = told.past.filter(({ state }) => state === "flashed").length;
      showCut(told.cut);
      const seen = JSON.stringify(told.past);
      if (seen !== key) {
        key = seen;
        write(note, told.total === 0 ? "Nothing yet: what is flashed is told here, with a way back." : `${counted(told.total, "time", "times")}, the newest first.`);
        past.replaceChildren(...told.past.map(row));
      }
      enable();
    } catch (error) {
      if (asked === drive) write(note, /** @type {Error} */ (error).message);
    }
  }

  /** @param {CutFlash | null} left */
  function showCut(left) {
    cut.hidden = left === null;
    if (left === null) return;
    write(cutWords, `A flash of “${left.name}”, version ${left.version}, by ${left.whom} was cut at ${clock(left.since)}: the drive has the values `
      + `before or the new ones, and ${counted(left.changed.length, "value was", "values were")} to change (${namesOf(left.changed.map(({ name }) => name))}). Finish it, or roll it back.`);
  }

  function enable() {
    rollback.disabled = hindered !== "" || others === 0;
    for (const one of past.querySelectorAll("button")) one.disabled = hindered !== "";
    write(rollbackWhy, others === 0 ? "Nothing was flashed from here yet." : hindered);
    const without = hindered.startsWith("A flash was cut") ? "" : hindered;
    finish.disabled = back.disabled = without !== "";
    write(cutWhy, without);
  }

  /** @param {PastFlash} one */
  function row(one) {
    return make("li", {}, make("time", { datetime: one.since }, clock(one.since)), make("span", { class: `chip ${MOODS[one.state]}` }, one.state),
      make("span", {}, make("strong", {}, one.name), ` version ${one.version}, by ${one.whom}`, one.override !== "" && `, in spite of doubts: ${one.override}`,
        make("span", { class: "row-facts" }, changesWords(one.changed)), one.state !== "flashed" && make("span", { class: "row-facts" }, sentenceCase(one.said))),
      one.state === "flashed" && make("button", { type: "button", class: "small", "aria-label": `Go back to before this: ${one.name}, ${clock(one.since)}`,
        "aria-describedby": rollbackWhy.id, onclick: () => askBack(one) }, "Go back to before this …"));
  }

  /** @param {PastFlash} [one] left out: the latest */
  async function askBack(one) {
    await tried(async () => {
      const asked = drive;
      const plan = await planRollback(asked, one?.since);
      const sure = await confirmed(`Roll ${asked} back to before ${one === undefined ? "its latest flash" : `“${one.name}” of ${clock(one.since)}`}?`,
        `${planWords(plan)} ${changesWords(plan.changes.map(({ signal, unit, old, new: after }) => ({ name: signal, unit, before: old, after })))} The drive is reset.`, "Roll it back");
      if (sure && asked === drive) follow(await askRollback(asked, one?.since));
    });
  }

  /** @param {boolean} toEnd */
  async function resume(toEnd) {
    await tried(async () => {
      const asked = drive;
      const sure = await confirmed(`${toEnd ? "Finish the flash of" : "Roll back the flash of"} ${asked}?`,
        `The drive gets ${toEnd ? "the new values" : "the values that it had before"}, stores them, and is reset.`, toEnd ? "Finish it" : "Roll it back");
      if (sure && asked === drive) follow(await askResume(asked, toEnd));
    });
  }

  /** Shows one that has begun until it ends. @param {Flash} flash */
  async function follow(flash) {
    if (following === flash.id) return;
    const mine = following = flash.id;
    const asked = drive;
    now.hidden = false;
    verdict.textContent = "";
    verdict.dataset.mood = "";
    for (let told = flash; ; told = await readFlash(asked, mine).catch(() => told)) {
      if (following !== mine || asked !== drive) return;
      bar.hidden = told.state !== "running";
      bar.value = told.progress;
      write(phase, told.state === "running" ? `${sentenceCase(told.phase || "beginning")} …` : "");
      if (steps.childElementCount !== told.steps.length || told.steps.length === 0) {
        steps.replaceChildren(...told.steps.map(({ at, said }) => make("li", {}, make("time", { datetime: at }, clock(at)), ` ${said}`)));
      }
      if (told.state !== "running") {
        following = "";
        verdict.dataset.mood = MOODS[told.state];
        verdict.textContent = `“${told.name}” ${told.state}: ${told.said}.`;
        key = "";
        refresh();
        return ended();
      }
      await new Promise((go_on) => setTimeout(go_on, POLL_MS));
    }
  }

  return {
    cut, now, history, follow,
    /** What an earlier one has told is over, where none is under way. */
    quiet() {
      if (following === "") now.hidden = true;
    },
    /** @param {string} why nothing can be flashed now; empty: it can */
    hinder(why) {
      if (why === hindered) return;
      hindered = why;
      enable();
    },
    /** @param {string} name */
    enter(name) {
      drive = name;
      following = key = message.textContent = "";
      now.hidden = cut.hidden = true;
      past.replaceChildren();
      clearInterval(timer);
      timer = setInterval(() => { if (!document.hidden) refresh(); }, REFRESH_MS);
      refresh();
    },
    leave() {
      clearInterval(timer);
      following = "";
    },
  };
}

/** @param {import("../api.js").FlashedValue[]} changed */
function changesWords(changed) {
  if (changed.length === 0) return "No value changed.";
  const scalars = changed.filter(({ name }) => tableOf(name) === null);
  const tables = [...new Set(changed.map(({ name }) => tableOf(name)).filter((name) => name !== null))];
  const told = scalars.slice(0, NAMED).map(({ name, unit, before, after }) => `${name} ${exact(before, DIGITS)} → ${exact(after, DIGITS)} ${unitShown(unit)}`.trim());
  const more = scalars.length > NAMED ? [`${scalars.length - NAMED} more`] : [];
  return `${[...told, ...more, ...tables.map((table) => `entries of ${table}`)].join(", ")}.`;
}

/** @param {string[]} names */
function namesOf(names) {
  const told = [...new Set(names.map((name) => tableOf(name) ?? name))];
  return told.slice(0, NAMED).join(", ") + (told.length > NAMED ? `, ${told.length - NAMED} more` : "");
}
