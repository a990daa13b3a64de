/**
 * The panel for captures: what to record, how far it is, where the file is. The fields are the operator's; the state
 * is the service's, whoever asked for the capture.
 *
 * @typedef {import("../api.js").Capture} Capture
 */

import { askCapture, cancelCapture, captureFile, NoAnswerError, triggerCapture } from "../api.js";
import { onHeardAgain } from "../connection.js";
import { element, input, number, wholeNumber, write } from "../fields.js";
import { clock, duration, integer, parseNumber } from "../format.js";
import { diagnoseIt } from "../rooms/diagnose_it.js";

const UNITS = new Map([["theta_e", "rad"], ["omega_e", "rad/s"], ["u_d", "V"], ["u_q", "V"], ["u_dc", "V"]]);
/** What a diagnosis needs. */
const ESTIMATED = ["theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q"];
const UNDER_WAY = ["armed", "triggered", "uploading"];
const WORDS = new Map([["armed", "Armed"], ["triggered", "Recording"], ["uploading", "Uploading from the drive"],
  ["done", "Done"], ["failed", "Failed"], ["cancelled", "Cancelled"]]);

const form = /** @type {HTMLFormElement} */ (element("capture-form"));
const length = input("capture-length");
const decimation = input("capture-decimation");
const begin = select("capture-trigger");
const signal = select("capture-signal");
const level = input("capture-level");
const bar = /** @type {HTMLProgressElement} */ (element("capture-progress"));
const link = /** @type {HTMLAnchorElement} */ (element("capture-file"));
const diagnose = /** @type {HTMLButtonElement} */ (element("capture-diagnose"));
const message = element("capture-message");
const buttons = ["capture-start", "capture-now", "capture-cancel"].map((id) => /** @type {HTMLButtonElement} */ (element(id)));
const [start, now, cancel] = buttons;

/** @type {string | null} */
let drive = null;
/** The newest capture that is known. @type {Capture | null} */
let latest = null;
let T_s = 0;
/** What the operator asked for and was refused; until the next thing they ask for. */
let refusal = "";
let unanswered = false;

/** @param {string} id */
function select(id) {
  return /** @type {HTMLSelectElement} */ (element(id));
}

export function buildCapturePanel() {
  for (const event of ["input", "change"]) form.addEventListener(event, fillFields);
  form.addEventListener("submit", (event) => { event.preventDefault(); ask((name) => askCapture(name, wanted())); });
  now.addEventListener("click", () => ask((name) => triggerCapture(name, latest?.id ?? "")));
  diagnose.addEventListener("click", () => ask(async (name) => {
    const of = /** @type {Capture} */ (latest);
    await diagnoseIt(of.id, name);
    return of;
  }));
  cancel.addEventListener("click", () => ask((name) => cancelCapture(name, latest?.id ?? "")));
  onHeardAgain(() => { if (unanswered) refusal = ""; });
  fillFields();
}

/** Forgets a drive, as when another is chosen. @param {string | null} name */
export function startCapturePanel(name) {
  drive = name;
  latest = null;
  refusal = "";
  fillState(false);
}

/**
 * @param {Capture | null} capture the drive's latest
 * @param {number} period control period in s; 0: not known
 * @param {boolean} connected whether the service is there
 */
export function showCapture(capture, period, connected) {
  if (T_s !== period) {
    T_s = period;
    fillFields();
  }
  if (!overtaken(capture)) latest = capture;
  fillState(connected);
}

/** Whether the answer to a button said later than this what the drive's capture is. @param {Capture | null} capture */
function overtaken(capture) {
  if (capture === null || latest === null) return false;
  if (capture.id !== latest.id) return Date.parse(capture.asked) < Date.parse(latest.asked);
  return UNDER_WAY.includes(capture.state) && !UNDER_WAY.includes(latest.state); // what has ended stays so
}

/** What goes with the fields as they are. */
function fillFields() {
  const byLevel = begin.value === "level";
  element("capture-level-entry").hidden = !byLevel;
  element("capture-waiting").hidden = begin.value === "now";
  write(element("capture-unit"), UNITS.get(signal.value) ?? "A");
  const [samples, every] = [parseNumber(length.value), parseNumber(decimation.value)];
  const known = samples !== null && every !== null && samples > 0 && every > 0 && T_s > 0;
  write(element("capture-duration"), known ? `= ${duration(samples * every * T_s)}` : "");
}

/** @param {boolean} connected */
function fillState(connected) {
  const state = latest?.state ?? "";
  const underWay = UNDER_WAY.includes(state);
  start.disabled = !connected || underWay;
  now.hidden = state !== "armed" || latest?.request.trigger === "now";
  cancel.hidden = !underWay;
  element("capture-state").hidden = latest === null;
  bar.hidden = !underWay;
  link.hidden = latest === null || latest.file === null;
  diagnose.hidden = true;
  if (latest !== null) fillCapture(latest);
  say(refusal !== "" ? refusal : state === "failed" ? (latest?.reason ?? "") : (latest?.remark ?? ""));
}

/** @param {Capture} capture */
function fillCapture({ id, drive: name, state, progress, samples, reason, file, asked, request }) {
  const waiting = state === "armed" || state === "uploading" ? reason : "";
  const counted = state === "armed" || (samples === 0 && state !== "triggered") ? ""
    : `, ${integer(samples)} of ${integer(request.length)} samples`;
  const ended = UNDER_WAY.includes(state) ? "" : ` (asked for at ${clock(asked)})`;
  write(element("capture-words"), `${WORDS.get(state) ?? state}${counted}${waiting === "" ? "" : `: ${waiting}`}${ended}`);
  bar.value = state === "armed" ? 0 : progress;
  element("capture-state").dataset.state = state;
  if (file === null) return;
  if (link.dataset.id !== id) {
    link.href = captureFile(name, id);
    link.dataset.id = id;
  }
  diagnose.hidden = state !== "done" || !ESTIMATED.every((name) => request.signals.includes(name)) || request.decimation !== 1;
  write(link, state === "done" ? "Download the recording" : "Download what was uploaded");
}

/** @param {(name: string) => Promise<Capture>} request */
async function ask(request) {
  refusal = "";
  const asked = drive;
  for (const button of buttons) button.disabled = true;
  try {
    if (asked === null) throw new Error("No drive to capture from.");
    const answer = await request(asked);
    if (asked === drive) latest = answer;
  } catch (error) {
    const { message: sentence } = /** @type {Error} */ (error);
    unanswered = error instanceof NoAnswerError;
    const after = unanswered ? " Whether it was taken is not known." : "";
    if (asked === drive) refusal = `${sentence}${after}`;
  } finally {
    for (const button of buttons) button.disabled = false;
    fillState(true);
  }
}

/** What to capture, in the service's words and SI. @returns {import("../api.js").CaptureRequest} */
function wanted() {
  const boxes = /** @type {NodeListOf<HTMLInputElement>} */ (form.querySelectorAll('input[name="capture-signals"]:checked'));
  /** @type {import("../api.js").CaptureRequest} */
  const body = {
    signals: [...boxes].map((box) => box.value),
    length: wholeNumber(length, "Samples"),
    decimation: wholeNumber(decimation, "Control periods per sample"),
  };
  if (begin.value === "now") return body;
  body.trigger = begin.value !== "level" ? "command"
    : { signal: signal.value, level: number(level, "Level"), edge: select("capture-edge").value };
  body.pre_trigger = number(input("capture-pre"), "Before the trigger") / 100;
  body.timeout_s = number(input("capture-timeout"), "Waiting time");
  return body;
}

/** @param {string} text */
function say(text) {
  message.dataset.mood = text === "" ? "" : "bad";
  write(message, text);
}
