/**
 * Commissionings of the drive: one is asked for, one under way is shown with its steps and can be stopped, and the latest
 * with how it ended, its report, and the set that it proposes.
 *
 * @typedef {import("../api.js").Commissioning} Commissioning
 * @typedef {import("../api.js").DriveState} DriveState
 */

import { NoAnswerError, NotThereError, askCommissioning, cancelCommissioning, commissioningReport, listCommissionings, readCommissioning } from "../api.js";
import { onHeardAgain } from "../connection.js";
import { confirmed } from "../dialog.js";
import { make } from "../dom.js";
import { number, write } from "../fields.js";
import { clock, duration } from "../format.js";
import { sentenceCase, words } from "./quantity.js";

const POLL_MS = 500;
const SETTLED = ["no_mismatch", "explained"];
/** What is done while the motor stands still, and may lead to its moving again. */
const DIAGNOSING = /^diagnosing\b/;
const LOST = "the service ended in the middle of it; the drive stops by itself";
const HOLDER = /^commissioning (\S+)/;
const TRIALS = "up to 0.7 of the speed that the dc link allows, within the drive's limits, with currents within the rated one. "
  + "A load that pulls turns the shaft while the drive is off.";
/** Of each kind: its name, what it finds out, and how the motor moves. */
const KINDS = {
  identify: { name: "Identification", finds: "parameters, inertia, and a set that is proposed",
    moves: `Speed and currents are stepped, then the speed swings between both directions, ${TRIALS} It may stand still for a minute or more while it is diagnosed, and move again after that, up to twice.` },
  first_start: { name: "First start", finds: "pole pairs, phase order, direction and angle offset",
    moves: "A current turns with a forced angle, and the rotor follows by less than one turn. The shaft has to be free." },
  verify: { name: "Verification", finds: "the loops, after a flash, beside what their gains promise",
    moves: `Speed and currents are stepped once more, ${TRIALS}` },
};
/** @typedef {keyof typeof KINDS} Kind */

/**
 * @param {(name: string, set: string) => void} propose is given a set, as TOML, that is to be planned
 * @param {() => void} ended is called when the drive can be read again
 */
export function commissioningView(propose, ended) {
  const kind = /** @type {HTMLSelectElement} */ (make("select", { id: "commissioning-kind", onchange: chooseKind },
    Object.entries(KINDS).map(([value, { name }]) => make("option", { value }, name))));
  const finds = make("span", { class: "hint" });
  const current = field("commissioning-current", "half of the rated one");
  const bandwidth = field("commissioning-bandwidth", "0.2 over the control period");
  const forwards = /** @type {HTMLSelectElement} */ (make("select", { id: "commissioning-forwards" },
    make("option", { value: "encoder" }, "as the encoder: swap the phases"), make("option", { value: "phases" }, "as the phases: reverse the encoder")));
  const goOn = /** @type {HTMLInputElement} */ (make("input", { id: "commissioning-follows", type: "checkbox", checked: true }));
  const goOnWords = make("span");
  const goOnEntry = make("label", { class: "switch", "data-of": "identify" }, goOn, goOnWords);
  const start = /** @type {HTMLButtonElement} */ (make("button", { type: "submit", id: "commissioning-start" }, "Commission …"));
  const why = make("span", { class: "hint", id: "commissioning-why" });
  const form = make("form", { id: "commissioning-form", autocomplete: "off", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); tried(ask); } },
    make("p", { class: "entry" }, make("label", { for: kind.id }, "Find out by"), kind, finds),
    entry("first_start", "Current, at most", current, "A"), entry("first_start", "Forwards", forwards, ""), entry("identify", "Bandwidth of the current control", bandwidth, "rad/s"), goOnEntry,
    make("div", { class: "actions" }, start, why));
  const title = make("strong", { id: "commissioning-title" });
  const phase = make("span", { id: "commissioning-phase", role: "status" });
  const since = make("span", { id: "commissioning-since" });
  const doing = make("p", { class: "phase" }, phase, since);
  const steps = make("ol", { class: "steps", id: "commissioning-steps" });
  const stepsBox = make("div", { class: "steps-box", tabindex: 0, role: "region", "aria-label": "Steps of the commissioning" }, steps);
  const stop = make("button", { type: "button", id: "commissioning-stop", class: "danger",
    onclick: () => tried(async () => { if (shown !== null) await cancelCommissioning(shown.drive, shown.id); }) }, "Stop the commissioning");
  const verdict = make("p", { class: "form-message", id: "commissioning-verdict", role: "status" });
  const remarks = make("div", { class: "told", hidden: true });
  const next = make("div", { class: "actions", id: "commissioning-next" });
  const latest = make("div", { id: "commissioning", hidden: true }, make("p", {}, title),
    doing, stepsBox, make("div", { class: "actions" }, stop), verdict, remarks, next);
  const note = make("p", { class: "section-note", id: "commissioning-note" });
  const message = make("p", { class: "form-message", id: "commissioning-message", role: "alert" });
  const root = make("div", { class: "commissioning" }, make("div", { class: "section-head" }, make("h3", {}, "Commissioning"), note), form, message, latest);

  let drive = "";
  /** @type {Commissioning | null} */
  let shown = null;
  /** Counts those that were followed: the latest alone is. */
  let turn = 0;
  /** Id of the one that the drive's state told of last. */
  let heard = "";
  /** Id of the one that the drive's state tells of, while it is read. */
  let reading = "";
  /** The first start that an identification would go on with. @type {Commissioning | null} */
  let first_start = null;

  /** @param {string} id @param {string} placeholder */
  function field(id, placeholder) {
    return /** @type {HTMLInputElement} */ (make("input", { id, inputmode: "decimal", class: "text", placeholder }));
  }

  /** @param {Kind} of @param {string} label @param {HTMLElement} entered @param {string} unit */
  function entry(of, label, entered, unit) {
    return make("p", { class: "entry", "data-of": of }, make("label", { for: entered.id }, label), entered, make("span", { class: "unit" }, unit));
  }

  function chooseKind() {
    const chosen = /** @type {Kind} */ (kind.value);
    write(finds, KINDS[chosen].finds);
    for (const one of form.querySelectorAll("[data-of]")) /** @type {HTMLElement} */ (one).hidden = /** @type {HTMLElement} */ (one).dataset.of !== chosen;
    if (first_start === null) goOnEntry.hidden = true;
  }

  /** What an identification would go on with. @param {Commissioning | undefined} latest that is done */
  function offer(latest) {
    const now = latest?.request.kind === "first_start" ? latest : null;
    if (now?.id !== first_start?.id) goOn.checked = true;
    first_start = now;
    if (now !== null) write(goOnWords, `Go on with the first start of ${clock(now.asked)}: one report tells of both. Where the drive was stopped since, or the service begun anew, that is refused; without the tick it is not.`);
    chooseKind();
  }

  /** @param {() => Promise<unknown>} what */
  async function tried(what) {
    const asked = drive;
    message.textContent = "";
    try {
      await what();
    } catch (error) {
      if (asked !== drive) return;
      message.dataset.mood = "bad";
      message.textContent = /** @type {Error} */ (error).message;
    }
  }

  async function ask() {
    const asked = drive;
    const chosen = /** @type {Kind} */ (kind.value);
    const told = (/** @type {HTMLInputElement} */ one, /** @type {string} */ what) => (one.value.trim() === "" ? null : number(one, what));
    const wanted = { kind: chosen, ...(chosen === "first_start" ? { current: told(current, "Current"), forwards: forwards.value }
      : chosen === "identify" ? { bandwidth: told(bandwidth, "Bandwidth"), follows: goOn.checked && first_start !== null ? first_start.id : null } : {}) };
    const sure = await confirmed(`${KINDS[chosen].name} of ${asked}? The motor will move.`,
      `${KINDS[chosen].moves} At its end the drive is off, its settings as they were, and nothing is flashed. Stop ends it at any time.`, "Run it");
    if (!sure || asked !== drive) return;
    const begun = await askCommissioning(asked, wanted);
    if (asked === drive) follow(begun);
  }

  /** Shows one until it ends. @param {Commissioning} first @param {boolean} [live] whether it was under way in sight of the page */
  async function follow(first, live = first.state === "running") {
    if (shown?.id === first.id) return;
    const mine = ++turn;
    shown = first;
    let told = first;
    let unknown = "";
    show(told, unknown);
    while (told.state === "running") {
      await new Promise((go_on) => setTimeout(go_on, POLL_MS));
      if (turn === mine) [told, unknown] = await readAgain(told);
      if (turn !== mine) return;
      show(told, unknown);
    }
    if (told.state === "done") offer(told);
    if (live) ended();
  }

  /** As it is now, and why that is not known; empty: it is. @param {Commissioning} told @returns {Promise<[Commissioning, string]>} */
  async function readAgain(told) {
    try {
      return [await readCommissioning(told.drive, told.id), ""];
    } catch (error) {
      if (error instanceof NotThereError) return [{ ...told, state: "failed", reason: LOST }, ""];
      return [told, error instanceof NoAnswerError ? "the service does not answer" : /** @type {Error} */ (error).message];
    }
  }

  /** @param {Commissioning} told @param {string} unknown why it is not known how far it is by now; empty: it is */
  function show(told, unknown) {
    const { request, asked, state } = told;
    const running = state === "running";
    const last = told.steps.at(-1);
    latest.hidden = false;
    form.hidden = running;
    doing.hidden = !running;
    write(note, "");
    write(title, `${KINDS[request.kind].name}, asked for ${clock(asked)}`);
    write(phase, !running ? "" : unknown !== "" ? `Not known: ${unknown}` : phaseWords(told.phase));
    const begun = Date.parse(last?.at ?? asked);
    const seconds = Math.max(1, Math.round((Date.now() - begun) / 1000));
    write(since, unknown !== "" ? "" : ` since ${clock(begun)}, ${seconds < 60 ? `${seconds} s` : duration(seconds)}`);
    if (JSON.stringify(told.steps) !== steps.dataset.told) {
      steps.dataset.told = JSON.stringify(told.steps);
      steps.replaceChildren(...told.steps.map(({ at, said }) => make("li", {}, make("time", { datetime: at }, clock(at)), ` ${said}`)));
      stepsBox.scrollTop = stepsBox.scrollHeight;
    }
    stepsBox.hidden = told.steps.length === 0;
    stop.hidden = !running;
    verdict.dataset.mood = mood(told);
    write(verdict, running ? "" : endWords(told));
    const { set = "", remarks: said = [] } = told.result;
    remarks.hidden = said.length === 0;
    remarks.replaceChildren(make("ul", {}, said.map((one) => make("li", {}, one))));
    const name = `the set of ${clock(asked)}`;
    next.replaceChildren(...(running ? [] : [
      set !== "" && make("button", { type: "button", id: "commissioning-plan", onclick: () => propose(name, set) }, "Plan its set"),
      set !== "" && make("a", { id: "commissioning-set", class: "small", href: `data:application/toml;charset=utf-8,${encodeURIComponent(set)}`, download: `${told.id}.toml` }, "The set as TOML"),
      state === "done" && request.kind !== "first_start" && make("a", { id: "commissioning-report", class: "small", href: commissioningReport(told.drive, told.id), target: "_blank" }, "Report"),
    ].filter((one) => one !== false)));
  }

  /** Shows the newest. */
  async function list() {
    const asked = drive;
    const all = await listCommissionings(asked);
    if (asked !== drive) return;
    offer(all.find(({ state }) => state === "done"));
    if (shown !== null) return;
    if (all.length > 0) follow(all[0]);
    else write(note, "None yet: what is found out of a motor, and the set that follows from it, is told here.");
  }

  /** Shows one that the drive's state tells of; where it cannot be read, that is tried again. @param {string} id */
  async function hear(id) {
    const asked = drive;
    reading = id;
    try {
      const told = await readCommissioning(asked, id);
      if (asked !== drive) return;
      heard = id;
      follow(told, true);
    } catch {
      await new Promise((go_on) => setTimeout(go_on, POLL_MS));
    } finally {
      if (reading === id) reading = "";
    }
  }

  onHeardAgain(() => { if (drive !== "" && shown === null) tried(list); });

  return {
    root,
    /** @param {DriveState} now @param {string} hindered why the drive may not be moved from here now; empty: it may */
    show({ control }, hindered) {
      start.disabled = hindered !== "";
      write(why, hindered);
      const id = control.in_experiment ? HOLDER.exec(control.whom ?? "")?.[1] : undefined;
      if (id !== undefined && ![shown?.id, heard, reading].includes(id)) hear(id);
    },
    /** @param {string} name */
    async enter(name) {
      drive = name;
      shown = null;
      heard = reading = message.textContent = "";
      turn += 1;
      latest.hidden = true;
      form.hidden = false;
      start.disabled = true;
      write(note, "");
      offer(undefined);
      await tried(list);
    },
    leave() {
      shown = null;
      drive = heard = reading = "";
      turn += 1;
    },
  };
}

/** @param {Commissioning} told */
function mood({ state, request, result }) {
  if (state === "running") return "";
  if (state !== "done") return state === "failed" ? "bad" : "warn";
  if (request.kind === "verify") return "";
  return result.diagnosis === undefined || SETTLED.includes(result.diagnosis.verdict) ? "good" : "warn";
}

/** What is being done. @param {string} phase */
function phaseWords(phase) {
  return `${sentenceCase(phase || "beginning")}${DIAGNOSING.test(phase) ? "; the motor may move again" : ""} …`;
}

/** Its sentence, which may begin with its verdict. @param {{verdict: string, sentence: string}} diagnosis */
function diagnosisWords({ verdict, sentence }) {
  const word = sentenceCase(words(verdict));
  return sentence.startsWith(word) ? sentence : `${word}: ${sentence}`;
}

/** How it ended, a sentence. @param {Commissioning} told */
function endWords({ state, reason, request, result }) {
  if (state !== "done") return `${sentenceCase(state)}: ${reason}.`;
  const late = reason === "" ? "" : ` ${sentenceCase(reason)}.`;
  if (result.diagnosis !== undefined) return diagnosisWords(result.diagnosis) + late;
  return (result.said !== undefined ? `${result.said}.` : `${KINDS[request.kind].name} done: its report tells how the loops did.`) + late;
}
