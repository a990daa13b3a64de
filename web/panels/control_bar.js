/**
 * The bar that never scrolls away: the drive's state in words, who controls it, Stop, Start and Reset. Stop is never
 * disabled, by mouse and by the Escape key, whether or not the service is heard, and never moves.
 *
 * @typedef {import("../api.js").Control} Control
 */

import { NoAnswerError, resetDrive, startDrive, stopDrive, writeSignals } from "../api.js";
import { element, write } from "../fields.js";
import { clock, kindOfJob } from "../format.js";
import { buildSetPoints, openSetPoints, showSetPoints, startSetPoints, tellSetPoints, wantedSetPoints } from "./set_points.js";

const ON = "operation enabled";
const NOTHING = { text: "", bad: false, of: /** @type {Control | null} */ (null), unheard: "" };

const bar = element("control-bar");
const stop = button("control-stop");
const begin = button("control-start");
const reset = button("control-reset");
const form = element("start-form");

/** @type {string | null} */
let drive = null;
/** @type {Control | null} */
let latest = null;
/**
 * What became of what was asked for by a button here: until the drive's state is another than that `of` which it was told.
 * `unheard`: what was asked for, where no answer came.
 */
let answer = NOTHING;

/** @param {string} id */
function button(id) {
  return /** @type {HTMLButtonElement} */ (element(id));
}

export function buildControlBar() {
  stop.addEventListener("click", askStop);
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !event.repeat) askStop();
  });
  begin.addEventListener("click", () => showForm(form.hidden));
  element("start-close").addEventListener("click", () => { showForm(false); begin.focus(); });
  buildSetPoints(askStart);
  reset.addEventListener("click", () => ask("Reset", resetDrive, async (control) => (
    { text: `Reset at ${clock(Date.now())}: ${stateWords(control)}`, bad: control.fault !== null })));
}

/** @param {boolean} wanted */
function showForm(wanted) {
  begin.setAttribute("aria-expanded", String(wanted));
  if (wanted) openSetPoints();
  else form.hidden = true;
}

/** Forgets a drive, as when another is chosen. @param {string | null} name */
export function startControlBar(name) {
  drive = name;
  latest = null;
  answer = NOTHING;
  startSetPoints(name);
  begin.setAttribute("aria-expanded", "false");
}

/**
 * @param {Control} control
 * @param {boolean} connected whether the service is there
 * @param {import("../api.js").SetPointLimits} limits how far set points may go
 */
export function showControl(control, connected, limits) {
  if (connected) overtake(control);
  latest = control;
  const known = connected && control.state !== null;
  bar.dataset.state = !known ? "unknown" : control.fault ? "fault" : control.state === ON ? "on" : "off";
  write(element("control-state"), connected ? stateWords(control) : "not known: the service is not heard");
  const who = connected ? holderWords(control) : "";
  const { safe_torque_off: sto, state } = control;
  write(element("control-who"), who);
  write(element("control-sto"), connected && state !== null && sto !== null ? `STO: ${sto}` : "");
  element("control-holder").title = who;
  write(element("control-fault"), connected ? faultWords(control) : "");
  begin.disabled = !known || control.fault !== null || byJob(control) || (control.holder !== null && !control.ours);
  write(element("control-why"), begin.disabled && connected ? `Start: ${whyNot(control, known)}` : "");
  const goes = known && goesBySetPoints(control);
  write(begin, goes ? "Set points" : "Start");
  showSetPoints(goes, begin.disabled, limits);
  reset.hidden = !known || control.fault === null;
  show();
}

/** Whether the service controls it for a job of its own. @param {Control} control */
function byJob(control) {
  return control.in_experiment || control.in_flash;
}

/** Whether it is on, and goes by the set points given here. @param {Control} control */
function goesBySetPoints(control) {
  return control.state === ON && control.ours && !byJob(control);
}

/** What the drive does, and what that is in CiA 402's words. @param {Control} control */
function stateWords({ state, fault }) {
  if (state === null) return "no link to the drive";
  if (state === ON) return `on: the motor is powered (${state})`;
  return fault === null ? `off: the motor is not powered (${state})` : `${state}: the motor is not powered`;
}

/** What an answer told is over where the drive's state is another by now. @param {Control} now */
function overtake(now) {
  const { of, unheard } = answer;
  if (of === null || Date.parse(now.seen ?? "") <= Date.parse(of.seen ?? "")) return;
  const other = now.state !== of.state || now.fault?.code !== of.fault?.code;
  if (other || (unheard === "Stop" && now.state !== ON)) answer = NOTHING;
  else if (unheard !== "") {
    const still = unheard === "Stop" ? "the motor is still powered: press Stop again" : "the drive is as it was: ask again";
    answer = { text: `${unheard} was not answered, and ${still}.`, bad: true, of: now, unheard: "" };
  }
}

/** @param {Control} control */
function holderWords(control) {
  const { holder, ours, whom, lease_left_s, guarded, state } = control;
  if (state === null) return "";
  if (byJob(control)) return `controlled by this service for ${whom}`;
  if (ours) return `controlled by this service${whom ? `, started from ${whom}` : ""}`;
  if (holder === "local") return "under local control, by a master inside the drive";
  if (holder !== null) return `controlled by ${holder}${lease_left_s === null ? "" : ", another bench"}`;
  return guarded === false ? "no control lease: any client may start it, and keeps it running" : "controlled by nobody";
}

/** @param {Control} control */
function faultWords({ fault, said, undone }) {
  const words = [];
  if (fault !== null) words.push(`${fault.name} (${fault.code}): ${fault.advice}.`);
  if (said !== "") words.push(`Control ended: ${said}.`);
  if (undone !== "") words.push(`${undone}.`);
  return words.join(" ");
}

/** @param {Control} control @param {boolean} known */
function whyNot(control, known) {
  const { fault, holder, whom } = control;
  if (!known) return "There is no link to the drive.";
  if (control.in_flash) return `${whom} is under way.`;
  if (control.in_experiment) return `the ${kindOfJob(whom)} is under way: stop it first.`;
  if (fault !== null) return "The drive is in fault: reset it first.";
  return `${holder} controls the drive: stop it first.`;
}

function askStop() {
  ask("Stop", stopDrive, async ({ state }) => (
    state === null ? { text: "Stop: there is no link to the drive. If the motor still turns, use its emergency stop.", bad: true }
    : state === ON ? { text: "Stop was taken, but the motor is still powered: use its emergency stop.", bad: true }
    : { text: `Stopped at ${clock(Date.now())}: the motor is not powered`, bad: false }), "If the motor still turns, use its emergency stop.");
}

async function askStart() {
  /** @type {ReturnType<typeof wantedSetPoints>} */
  let wanted;
  try {
    wanted = wantedSetPoints();
  } catch (error) {
    return say({ ...NOTHING, text: /** @type {Error} */ (error).message, bad: true });
  }
  const { values, kind } = wanted;
  const applies = latest !== null && goesBySetPoints(latest);
  const start = async (/** @type {string} */ name) => {
    if (kind !== null) await writeSignals(name, { excitation_kind: kind });
    return startDrive(name, values);
  };
  await ask(applies ? "Set points" : "Start", start, async (control) => {
    showForm(false);
    await tellSetPoints();
    const at = `${applies ? "Set points applied" : "Started"} at ${clock(Date.now())}`;
    return control.state === ON ? { text: at, bad: false } : { text: `${at}: ${stateWords(control)}`, bad: true };
  });
}

/**
 * @param {string} what
 * @param {(name: string) => Promise<Control>} request
 * @param {(control: Control) => Promise<{text: string, bad: boolean}>} done what became of it
 * @param {string} [otherwise] what to do where no answer comes
 */
async function ask(what, request, done, otherwise = "") {
  const asked = drive;
  if (asked === null) return say({ ...NOTHING, text: "No drive to control.", bad: true });
  say({ ...NOTHING, text: `${what} of ${asked} is asked for …` });
  try {
    const of = await request(asked);
    say({ ...NOTHING, ...await done(of), of });
  } catch (error) {
    const { message } = /** @type {Error} */ (error);
    const lost = error instanceof NoAnswerError;
    const text = `${what}: ${message}${lost ? " Whether it was taken is not known." : ""} ${otherwise}`.trim();
    say({ text, bad: true, of: latest, unheard: lost ? what : "" });
  }
}

/** @param {typeof NOTHING} said */
function say(said) {
  answer = said;
  show();
}

function show() {
  const target = element("control-answer");
  target.dataset.mood = answer.bad ? "bad" : "";
  write(target, answer.text);
}
