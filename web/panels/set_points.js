/**
 * Set points of the drive: the form that gives them with how far they may go, and the line that tells those that hold.
 *
 * @typedef {import("../api.js").SetPointLimits} SetPointLimits
 */

import { readSignals } from "../api.js";
import { element, input, number, write } from "../fields.js";
import { parseNumber, plain } from "../format.js";

const SET_POINTS = ["i_d_ref", "i_q_ref", "i_d_step", "i_q_step", "speed_ref", "speed_step"];
const [KIND, OF_SPEED] = ["excitation_kind", "speed_control"];
/** Beyond which the drive switches itself off. */
const TRIPS = ["overcurrent_trip", "overspeed_trip"];
const REFRESH_MS = 5000;

const form = /** @type {HTMLFormElement} */ (element("start-form"));
const submit = /** @type {HTMLButtonElement} */ (element("start-submit"));
const kinds = /** @type {HTMLSelectElement} */ (element(`start-${KIND}`));
const line = element("set-points");

/** @type {string | null} */
let drive = null;
/** What the drive told when the form was opened. @type {Map<string, number>} */
let told = new Map();
/** @type {SetPointLimits | null} */
let limits = null;
/** When those that hold were asked for last. */
let asked = 0;

/** @param {() => void} given is called once they are to be given */
export function buildSetPoints(given) {
  form.addEventListener("submit", (event) => { event.preventDefault(); given(); });
  form.addEventListener("input", sayLimits);
}

/** Forgets a drive, as when another is chosen. @param {string | null} name */
export function startSetPoints(name) {
  drive = name;
  asked = 0;
  form.hidden = true;
  write(line, "");
}

/**
 * @param {boolean} hold whether the drive goes by those given here
 * @param {boolean} disabled whether none can be given
 * @param {SetPointLimits} most how far they may go
 */
export function showSetPoints(hold, disabled, most) {
  limits = most;
  submit.disabled = disabled;
  write(submit, hold ? "Apply set points" : `Start ${drive ?? ""}`.trim());
  if (!hold) {
    asked = 0;
    write(line, "");
  } else if (!document.hidden && Date.now() - asked > REFRESH_MS) tellSetPoints();
}

/** Reads those that hold, and shows them. */
export async function tellSetPoints() {
  const name = drive;
  asked = Date.now();
  const mine = asked;
  if (name === null) return;
  const now = await read(name, [...SET_POINTS, OF_SPEED, KIND]);
  if (drive === name && asked === mine) write(line, now.size === 0 ? "" : `Set points: ${words(now)}`);
}

/** Set points as the drive has them, zero until it has told them; what is typed meanwhile stays. */
export async function openSetPoints() {
  form.hidden = false;
  window.scrollTo(0, 0);
  input("start-i_q_ref").focus();
  for (const name of SET_POINTS) input(`start-${name}`).value = "0";
  const name = drive;
  told = new Map();
  sayLimits();
  const now = name === null ? new Map() : await read(name, [...SET_POINTS, OF_SPEED, KIND, ...TRIPS]);
  if (drive !== name) return;
  told = now;
  if (told.has(KIND)) kinds.value = String(told.get(KIND));
  for (const label of form.querySelectorAll("[data-of=speed]")) /** @type {HTMLElement} */ (label).hidden = !told.get(OF_SPEED);
  for (const point of SET_POINTS.filter((point) => told.has(point))) {
    const field = input(`start-${point}`);
    if (field.value === "0") field.value = plain(told.get(point) ?? 0, 4);
  }
  sayLimits();
}

/**
 * What is typed, SI, and the kind of excitation where it is to be another. Throws a sentence where it is no set point.
 * @returns {{values: Record<string, number>, kind: number | null}}
 */
export function wantedSetPoints() {
  if (told.size === 0) throw new Error("The drive's set points have not been read: close the form and open it again.");
  const values = Object.fromEntries(SET_POINTS.map((name) => [name, number(input(`start-${name}`), name)]));
  const kind = Number(kinds.value);
  return { values, kind: told.has(KIND) && kind !== told.get(KIND) ? kind : null };
}

/** @param {string} name @param {string[]} names @returns {Promise<Map<string, number>>} empty where it does not tell */
async function read(name, names) {
  const signals = await readSignals(name, names).catch(() => []);
  return new Map(signals.map((signal) => [signal.name, signal.value]));
}

/** @param {Map<string, number>} now */
function words(now) {
  const value = (/** @type {string} */ name) => plain(now.get(name) ?? 0, 4).replace("-", "−");
  const kind = now.get(KIND) ?? null;
  const steps = ["i_d", "i_q"].filter((name) => kind !== 0 && now.get(`${name}_step`)).map((name) => `${name} ± ${value(`${name}_step`)} A`);
  return [
    `i_d ${value("i_d_ref")} A`, now.get(OF_SPEED) ? `speed ${value("speed_ref")} rad/s` : `i_q ${value("i_q_ref")} A`,
    steps.length === 0 ? "" : `steps of ${steps.join(" and ")}${kind === null ? "" : ` as ${kinds.options[kind]?.text ?? kind}`}`,
    now.get(OF_SPEED) && now.get("speed_step") ? `ramps of ± ${value("speed_step")} rad/s` : "",
  ].filter((part) => part !== "").join(", ");
}

/** How far set points may go, and how far these do. */
function sayLimits() {
  const [i_d, i_q, di_d, di_q] = SET_POINTS.slice(0, 4).map((name) => parseNumber(input(`start-${name}`).value) ?? NaN);
  const i = Math.hypot(Math.abs(i_d) + di_d, Math.abs(i_q) + di_q);
  const { i_max = null, speed_max_rpm = null } = limits ?? {};
  const [current, speed] = TRIPS.map((name) => told.get(name) ?? null);
  const far = i_max ?? current;
  const reach = Number.isNaN(i) || far === null ? "." : `; these, with their steps, go to ${plain(i, 3)} A${i > far ? ", too far" : ""}.`;
  const target = element("start-limits");
  write(target, [
    i_max !== null ? `Currents go up to ${i_max} A${reach}`
      : current !== null ? `No limit of current is configured; the drive switches itself off beyond ${plain(current, 4)} A${reach}`
      : "No limit of current is configured.",
    speed_max_rpm !== null ? `Speeds go up to ${speed_max_rpm} rpm.`
      : speed !== null ? `The drive switches itself off beyond ${plain(speed, 4)} rad/s.` : "",
  ].join(" ").trim());
  target.classList.toggle("warn", far !== null && i > far);
}
