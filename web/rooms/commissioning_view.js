/**
 * Commissionings of the drive: one is asked for, one under way is shown with its steps and can be stopped, and the latest
 * with how it ended, its report, and the set that it proposes.
 *
 * @typedef {import("../api.js").Commissioning} Commissioning
 * @typedef {import("../api.js").DriveState} DriveState
 */

import { askCommissioning, cancelCommissioning, commissioningReport, listCommissionings, readCommissioning } from "../api.js";
import { confirmed } from "../dialog.js";
import { make } from "../dom.js";
import { number, write } from "../fields.js";
import { clock, duration } from "../format.js";
import { sentenceCase, words } from "./quantity.js";

const POLL_MS = 500;
const SETTLED = ["no_mismatch", "explained"];
const HOLDER = /^commissioning (\S+)/;
const TRIALS = "up to 0.7 of the speed that the dc link allows, within the drive's limits, with currents within the rated one. "
  + "A load that pulls turns the shaft while the drive is off.";
/** Of each kind: its name, what it finds out, and how the motor moves. */
const KINDS = {
  identify: { name: "Identification", finds: "parameters, inertia, and a set that is proposed",
    moves: `Speed and currents are stepped, then the speed swings between both directions, ${TRIALS}` },
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
  const start = /** @type {HTMLButtonElement} */ (make("button", { type: "submit", id: "commissioning-start" }, "Commission …"));
  const why = make("span", { class: "hint", id: "commissioning-why" });
  const form = make("form", { id: "commissioning-form", autocomplete: "off", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); tried(ask); } },
    make("p", { class: "entry" }, make("label", { for: kind.id }, "Find out by"), kind, finds),
    entry("first_start", "Current, at most", current, "A"), entry("first_start", "Forwards", forwards, ""), entry("identify", "Bandwidth of the current control", bandwidth, "rad/s"),
    make("div", { class: "actions" }, start, why));
  const title = make("strong", { id: "commissioning-title" });
  const phase = make("span", { id: "commissioning-phase", role: "status" });
  const since = make("span", { id: "commissioning-since" });
  const doing = make("p", { class: "phase" }, phase, since);
  const steps = make("ol", { class: "steps", id: "commissioning-steps" });
  const stepsBox = make("div", { class: "steps-box", tabindex: 0, role: "region", "aria-label": "Steps of the commissioning" }, steps);
  const stop = make("button", { type: "button", id: "commissioning-stop", class: "danger", onclick: () => tried(async () => { await cancelCommissioning(drive, shown); }) }, "Stop the commissioning");
  const verdict = make("p", { class: "form-message", id: "commissioning-verdict", role: "status" });
  const remarks = make("div", { class: "told", hidden: true });
  const next = make("div", { class: "actions", id: "commissioning-next" });
  const latest = make("div", { id: "commissioning", hidden: true }, make("p", {}, title),
    doing, stepsBox, make("div", { class: "actions" }, stop), verdict, remarks, next);
  const note = make("p", { class: "section-note", id: "commissioning-note" });
  const message = make("p", { class: "form-message", id: "commissioning-message", role: "alert" });
  const root = make("div", { class: "commissioning" }, make("div", { class: "section-head" }, make("h3", {}, "Commissioning"), note), form, message, latest);

  let drive = "";
  /** Id of the one shown. */
  let shown = "";
  /** Counts those that were followed: the latest alone is. */
  let turn = 0;
  /** Id of the one that the drive's state told of last. */
  let heard = "";

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

  async function ask() {
    const asked = drive;
    const chosen = /** @type {Kind} */ (kind.value);
    const told = (/** @type {HTMLInputElement} */ one, /** @type {string} */ what) => (one.value.trim() === "" ? null : number(one, what));
    const wanted = { kind: chosen, ...(chosen === "first_start" ? { current: told(current, "Current"), forwards: forwards.value }
      : chosen === "identify" ? { bandwidth: told(bandwidth, "Bandwidth") } : {}) };
    const sure = await confirmed(`${KINDS[chosen].name} of ${asked}? The motor will move.`,
      `${KINDS[chosen].moves} At its end the drive is off, its settings as they were, and nothing is flashed. Stop ends it at any time.`, "Run it");
    if (sure && asked === drive) follow(await askCommissioning(asked, wanted));
  }

  /** Shows one until it ends. @param {Commissioning} first */
  async function follow(first) {
    if (shown === first.id) return;
    const asked = drive;
    const mine = ++turn;
    shown = first.id;
    for (let told = first; ; told = await readCommissioning(asked, first.id).catch(() => told)) {
      if (turn !== mine) return;
      show(told);
      if (told.state !== "running") break;
      await new Promise((go_on) => setTimeout(go_on, POLL_MS));
    }
    if (first.state === "running") ended();
  }

  /** @param {Commissioning} told */
  function show(told) {
    const { request, asked, state } = told;
    const running = state === "running";
    const last = told.steps.at(-1);
    latest.hidden = false;
    form.hidden = running;
    doing.hidden = !running;
    write(note, "");
    write(title, `${KINDS[request.kind].name}, asked for ${clock(asked)}`);
    write(phase, running ? `${sentenceCase(told.phase || "beginning")} …` : "");
    const begun = Date.parse(last?.at ?? asked);
    const seconds = Math.max(1, Math.round((Date.now() - begun) / 1000));
    write(since, ` since ${clock(begun)}, ${seconds < 60 ? `${seconds} s` : duration(seconds)}`);
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
      state === "done" && request.kind !== "first_start" && make("a", { id: "commissioning-report", class: "small", href: commissioningReport(drive, told.id), target: "_blank" }, "Report"),
    ].filter((one) => one !== false)));
  }

  return {
    root,
    /** @param {DriveState} now @param {string} hindered why the drive may not be moved from here now; empty: it may */
    show({ control }, hindered) {
      start.disabled = hindered !== "";
      write(why, hindered);
      const id = control.in_experiment ? HOLDER.exec(control.whom ?? "")?.[1] : undefined;
      if (id === undefined || id === shown || id === heard) return;
      const asked = drive;
      heard = id;
      tried(async () => {
        const told = await readCommissioning(asked, id);
        if (asked === drive) follow(told);
      });
    },
    /** @param {string} name */
    async enter(name) {
      drive = name;
      shown = heard = message.textContent = "";
      turn += 1;
      latest.hidden = true;
      form.hidden = false;
      start.disabled = true;
      chooseKind();
      write(note, "");
      await tried(async () => {
        const [newest] = await listCommissionings(name);
        if (name !== drive || shown !== "") return;
        if (newest !== undefined) follow(newest);
        else write(note, "None yet: what is found out of a motor, and the set that follows from it, is told here.");
      });
    },
    leave() {
      shown = heard = "";
      turn += 1;
    },
  };
}

/** @param {Commissioning} told */
function mood({ state, result }) {
  if (state === "running") return "";
  if (state !== "done") return state === "failed" ? "bad" : "warn";
  return result.diagnosis === undefined || SETTLED.includes(result.diagnosis.verdict) ? "good" : "warn";
}

/** How it ended, a sentence. @param {Commissioning} told */
function endWords({ state, reason, request, result }) {
  if (state !== "done") return `${sentenceCase(state)}: ${reason}.`;
  const late = reason === "" ? "" : ` ${sentenceCase(reason)}.`;
  if (result.diagnosis !== undefined) return `${sentenceCase(words(result.diagnosis.verdict))}: ${result.diagnosis.sentence}${late}`;
  return (result.said !== undefined ? `${result.said}.` : `${KINDS[request.kind].name} done: its report tells how the loops did.`) + late;
}
