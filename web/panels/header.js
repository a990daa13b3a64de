/**
 * What the bar says of the drive in every room - which one, how its link is, what it does now - and, in the room of the
 * drive, what its stream has delivered and lost.
 *
 * @typedef {import("../api.js").DriveState} DriveState
 */

import { address } from "../router.js";
import { age, clock, duration, fixed, integer } from "../format.js";

/** The share of the drive's rows that have to come. */
const LEAST = 0.95;

/** How long an error that is over stands in the bar, which is narrow. */
const PAST_ERROR_MS = 60_000;

const element = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
const select = /** @type {HTMLSelectElement} */ (element("drive-select"));

/**
 * Fills the drive selector; with a single drive there is nothing to choose and it stays away.
 * @param {DriveState[]} drives
 * @param {string | null} chosen
 */
export function showDrives(drives, chosen) {
  element("drive-choice").hidden = drives.length < 2;
  element("drive-name").hidden = drives.length >= 2;
  write("drive-name", chosen ?? "");
  select.replaceChildren(...drives.map(({ name }) => new Option(name, name, false, name === chosen)));
}

/** @param {(name: string) => void} listener */
export function onDriveChosen(listener) {
  select.addEventListener("change", () => listener(select.value));
}

/**
 * @param {DriveState} drive
 * @param {number} sinceSnapshot_s time since the service last sent, in seconds
 * @param {boolean} connected whether the service is there
 */
export function showDrive(drive, sinceSnapshot_s, connected) {
  showLink(drive, connected);
  write("identity", identityLine(drive));
  const { stream } = drive;
  const nominal = stream.nominal_rate_hz;
  const counted = connected && drive.link.state === "streaming" && nominal !== null && stream.rate_hz > 0;
  const slow = counted && stream.rate_hz < LEAST * nominal;
  const of = nominal === null ? "" : `of ${rate(nominal)}`;
  write("fact-rate", rate(stream.rate_hz), slow ? `${of}: too slow` : of);
  element("fact-rate").classList.toggle("warn", slow);
  element("bar-slow").hidden = !slow;
  write("bar-slow", slow ? `Slow: ${rate(stream.rate_hz)} ${of} come` : "");
  const age_s = stream.age_s === null ? null : stream.age_s + sinceSnapshot_s;
  write("fact-age", age_s === null ? "no data" : age(age_s));
  element("fact-age").classList.toggle("warn", age_s === null || age_s > 1);
  write("fact-rows", integer(stream.rows));
  write("fact-gaps", integer(stream.gaps));
  write("fact-lost", integer(stream.rows_lost));
  write("fact-reconnects", integer(drive.link.reconnects));
  showReadings(drive.latest, connected);
  writeWhereAny("fact-late", stream.frames_late);
  writeWhereAny("fact-foreign", stream.frames_foreign);
  writeWhereAny("fact-resets", stream.clock_resets);
  const cut = connected ? drive.cut_flash : null;
  element("bar-cut").hidden = cut === null;
  element("bar-cut").setAttribute("href", address("drive", drive.name));
  write("bar-cut", cut === null ? "" : `A flash of “${cut.name}” was cut: finish it, or roll it back.`);
  element("stream-note").hidden = stream.note === "";
  write("stream-note", stream.note);
  element("fact-gaps").classList.toggle("warn", stream.gaps > 0);
  element("fact-lost").classList.toggle("warn", stream.rows_lost > 0);
}

/**
 * @param {import("../api.js").Latest | null} latest
 * @param {boolean} connected
 */
function showReadings(latest, connected) {
  const told = connected ? latest : null;
  const speed = told?.speed_rpm ?? null;
  const omega_e = told?.omega_e ?? null;
  write("bar-speed", speed !== null ? `${fixed(speed, 0)} rpm` : omega_e !== null ? `${fixed(omega_e, 1)} rad/s el.` : "–");
  for (const name of /** @type {const} */ (["i_d", "i_q"])) {
    const value = told?.[name] ?? null;
    write(`bar-${name}`, value === null ? "–" : `${fixed(value, 2)} A`);
  }
}

/**
 * @param {DriveState} drive
 * @param {boolean} connected
 */
function showLink({ name, link }, connected) {
  const words = connected ? linkWords(link) : "not known";
  element("link").dataset.state = connected ? link.state : "unknown";
  write("link-state", words);
  const title = `${words} · ${name} · pmsm-bench`;
  if (document.title !== title) document.title = title;
  const error = link.last_error;
  const past = link.state === "streaming" ? "Last error, " : "";
  element("link-error").hidden = error === null || (past !== "" && Date.now() - Date.parse(error.time) > PAST_ERROR_MS);
  element("link-error").classList.toggle("past", past !== "");
  if (error !== null) write("link-error", `${past}${clock(error.time)}: ${error.sentence}`);
}

/** @param {string} id @param {number} count of something that is rare */
function writeWhereAny(id, count) {
  /** @type {HTMLElement} */ (element(id).parentElement).hidden = count === 0;
  write(id, integer(count));
}

/** @param {import("../api.js").Link} link */
function linkWords(link) {
  return link.state === "lost" ? `lost since ${clock(link.since)}` : link.state;
}

/** @param {DriveState} drive */
function identityLine({ name, url, identity }) {
  if (identity === null) return `${name} · not identified yet · ${url}`;
  return `${name} · ${identity.device_name}, serial ${identity.serial} · ${url}`
    + ` · control period ${duration(identity.T_s)}`;
}

/** @param {number} hertz */
function rate(hertz) {
  return `${fixed(hertz, hertz > 0 && hertz < 10 ? 1 : 0)} Hz`;
}

/**
 * Writes only what changed: no needless layout, no repeated announcement.
 * @param {string} id
 * @param {string} text
 * @param {string} [aside]
 */
function write(id, text, aside = "") {
  const target = element(id);
  const whole = aside === "" ? text : `${text} ${aside}`;
  if (target.textContent === whole) return;
  if (aside === "") {
    target.textContent = text;
    return;
  }
  const small = document.createElement("small");
  small.textContent = aside;
  target.replaceChildren(text, " ", small);
}
