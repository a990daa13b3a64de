/**
 * The bar that never scrolls away: the drive's state in words, who controls it, Stop, Start and Reset. Stop is never
 * disabled, by mouse and by the Escape key, whether or not the service is heard.
 *
 * @typedef {import("../api.js").Control} Control
 */

import { NoAnswerError, readSignals, resetDrive, startDrive, stopDrive, writeSignals } from "../api.js";
import { element, input, number, write } from "../fields.js";
import { clock, parseNumber, plain } from "../format.js";

const SET_POINTS = ["i_d_ref", "i_q_ref", "i_d_step", "i_q_step", "speed_ref", "speed_step"];
const KIND = "excitation_kind";
const ON = "operation enabled";

const bar = element("control-bar");
const stop = button("control-stop");
const begin = button("control-start");
const reset = button("control-reset");
const form = /** @type {HTMLFormElement} */ (element("start-form"));
const submit = button("start-submit");

/** @type {string | null} */
let drive = null;
/** What was asked for by a button here, and how it went; until the next one. */
let answer = "";
let bad = false;
/** Whether the form shows what the drive has told, and which set points it has. */
let filled = false;
/** How the drive excites, by its dictionary; null where it has not told. @type {number | null} */
let kind = null;
/** @type {import("../api.js").SetPointLimits | null} */
let limits = null;

/** @param {string} id */
function button(id) {
  return /** @type {HTMLButtonElement} */ (element(id));
}

export function buildControlBar() {
  stop.addEventListener("click", askStop);
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !event.repeat) askStop();
  });
  begin.addEventListener("click", () => {
    form.hidden = !form.hidden;
    begin.setAttribute("aria-expanded", String(!form.hidden));
    if (form.hidden) return;
    fill();
    input("start-i_q_ref").focus();
  });
  form.addEventListener("submit", (event) => { event.preventDefault(); askStart(); });
  form.addEventListener("input", sayLimits);
  reset.addEventListener("click", () => ask("Reset", (name) => resetDrive(name)));
}

/** Forgets a drive, as when another is chosen. @param {string | null} name */
export function startControlBar(name) {
  drive = name;
  answer = "";
  form.hidden = true;
  write(submit, `Start ${name ?? ""}`.trim());
}

/**
 * @param {Control} control
 * @param {boolean} connected whether the service is there
 * @param {import("../api.js").SetPointLimits} told how far set points may go
 */
export function showControl(control, connected, told) {
  limits = told;
  const state = connected ? control.state ?? "no link to the drive" : "not known: the service is not heard";
  const kind = !connected || control.state === null ? "unknown" : control.fault ? "fault" : control.state === ON ? "on" : "off";
  bar.dataset.state = kind;
  write(element("control-state"), kind === "on" ? `${state}: the motor is powered` : state);
  write(element("control-holder"), connected ? holderWords(control) : "");
  write(element("control-fault"), connected ? faultWords(control) : "");
  const known = connected && control.state !== null;
  begin.disabled = !known || control.fault !== null || control.in_experiment || (control.holder !== null && !control.ours);
  write(element("control-why"), begin.disabled && connected ? `Start: ${whyNot(control, known)}` : "");
  write(begin, control.state === ON && control.ours && !control.in_experiment ? "Set points" : "Start");
  reset.hidden = !known || control.fault === null;
  show(answer !== "" ? answer : "", bad);
}

/** @param {Control} control */
function holderWords(control) {
  const { holder, ours, whom, lease_left_s, guarded, state, safe_torque_off } = control;
  const sto = safe_torque_off === null ? "" : ` · STO: ${safe_torque_off}`;
  if (state === null) return "";
  if (control.in_experiment) return `controlled by this service for ${whom}${sto}`;
  if (ours) return `controlled by this service${whom ? `, started from ${whom}` : ""}${sto}`;
  if (holder === "local") return `under local control, by a master inside the drive${sto}`;
  if (holder !== null) return `controlled by ${holder}${lease_left_s === null ? "" : ", another bench"}${sto}`;
  return guarded === false ? `no control lease: any client may start it, and keeps it running${sto}` : `controlled by nobody${sto}`;
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
  if (control.in_experiment) return `${whom} is under way: stop it first.`;
  if (fault !== null) return "The drive is in fault: reset it first.";
  return `${holder} controls the drive: stop it first.`;
}

/** Set points as the drive has them, zero until it has told them; what is typed meanwhile stays. */
async function fill() {
  for (const name of SET_POINTS) input(`start-${name}`).value = "0";
  const asked = drive;
  if (asked === null) return;
  filled = false;
  sayLimits();
  const told = await readSignals(asked, [...SET_POINTS, "speed_control", KIND]).catch(() => []);
  if (drive !== asked) return;
  filled = told.length > 0;
  kind = told.find(({ name }) => name === KIND)?.value ?? null;
  if (kind !== null) input(`start-${KIND}`).value = String(kind);
  const ofSpeed = told.some(({ name, value }) => name === "speed_control" && value !== 0);
  for (const label of form.querySelectorAll("[data-of=speed]")) /** @type {HTMLElement} */ (label).hidden = !ofSpeed;
  for (const { name, value } of told.filter(({ name }) => SET_POINTS.includes(name))) {
    const field = input(`start-${name}`);
    if (field.value === "0") field.value = String(Number(value.toPrecision(4)));
  }
  sayLimits();
}

/** How far set points may go, and how far these do. */
function sayLimits() {
  const [i_d, i_q, di_d, di_q] = SET_POINTS.slice(0, 4).map((name) => parseNumber(input(`start-${name}`).value) ?? NaN);
  const i = Math.hypot(Math.abs(i_d) + di_d, Math.abs(i_q) + di_q);
  const { i_max = null, speed_max_rpm = null } = limits ?? {};
  const words = [
    i_max === null ? "No current limit is configured: the drive's own holds." : `Currents go up to ${i_max} A`
      + (Number.isNaN(i) ? "." : `; these, with their steps, to ${plain(i, 3)} A${i > i_max ? ", too far" : ""}.`),
    speed_max_rpm === null ? "" : `Speeds go up to ${speed_max_rpm} rpm.`,
  ];
  const target = element("start-limits");
  write(target, words.join(" ").trim());
  target.classList.toggle("warn", i_max !== null && i > i_max);
}

function askStop() {
  ask("Stop", (name) => stopDrive(name), "If the motor still turns, use its emergency stop.");
}

async function askStart() {
  if (!filled) {
    say("The drive's set points have not been read: close the form and open it again.", true);
    return;
  }
  /** @type {Record<string, number>} */
  const values = {};
  try {
    for (const name of SET_POINTS) values[name] = number(input(`start-${name}`), name);
  } catch (error) {
    say(/** @type {Error} */ (error).message, true);
    return;
  }
  const wanted = Number(input(`start-${KIND}`).value);
  const start = async (/** @type {string} */ name) => {
    if (kind !== null && wanted !== kind) await writeSignals(name, { [KIND]: wanted });
    return startDrive(name, values);
  };
  if (await ask("Start", start)) form.hidden = true;
}

/**
 * @param {string} what
 * @param {(name: string) => Promise<Control>} request
 * @param {string} [otherwise] what to do where no answer comes
 */
async function ask(what, request, otherwise = "") {
  const asked = drive;
  if (asked === null) return say("No drive to control.", true);
  say(`${what} of ${asked} is asked for …`, false);
  try {
    const control = await request(asked);
    return say(`${what} of ${asked}, ${clock(new Date().toISOString())}: ${control.state ?? "no link"}.`, control.state === null);
  } catch (error) {
    const { message } = /** @type {Error} */ (error);
    const after = error instanceof NoAnswerError ? " Whether it was taken is not known." : "";
    return say(`${what}: ${message}${after} ${otherwise}`.trim(), true);
  }
}

/** @param {string} text @param {boolean} mood @returns {boolean} whether all is well */
function say(text, mood) {
  answer = text;
  bad = mood;
  show(text, mood);
  return !mood;
}

/** @param {string} text @param {boolean} mood */
function show(text, mood) {
  const target = element("control-answer");
  target.dataset.mood = mood ? "bad" : "";
  write(target, text);
}
