/**
 * The service's REST calls and the shapes they carry. Every failure is an Error whose message is a sentence.
 *
 * @typedef {{sentence: string, time: string}} LinkError
 * @typedef {{state: "connecting" | "streaming" | "lost", since: string, reconnects: number,
 *   last_error: LinkError | null}} Link
 * @typedef {{rate_hz: number, nominal_rate_hz: number | null, rows: number, gaps: number, rows_lost: number,
 *   clock_resets: number, frames_late: number, frames_foreign: number, note: string,
 *   age_s: number | null, t_drive_s: number | null}} Stream
 * @typedef {{device_name: string, serial: number, T_s: number}} Identity
 * @typedef {{holder: string, until: string}} Writer
 * @typedef {{i_d: number | null, i_q: number | null, u_d: number | null, u_q: number | null, u_dc: number | null,
 *   omega_e: number | null, speed_rpm: number | null, temp_winding: number | null, temp_magnet: number | null}} Latest
 * @typedef {{i_max: number | null, speed_max_rpm: number | null, n_p: number | null}} SetPointLimits
 * @typedef {{name: string, url: string, identity: Identity | null, link: Link, stream: Stream,
 *   latest: Latest | null, limits: SetPointLimits, writer: Writer | null, control: Control}} DriveState
 * @typedef {{code: string, name: string, advice: string}} Fault
 * @typedef {{state: string | null, fault: Fault | null, holder: string | null, lease_left_s: number | null,
 *   ours: boolean, whom: string | null, in_experiment: boolean, said: string, undone: string, guarded: boolean | null,
 *   safe_torque_off: string | null}} Control
 * @typedef {{value: number | null, std: number | null, unit: string,
 *   status: "ok" | "doubtful" | "stale" | "held" | "not_told" | "no_data", since: string | null, reason: string,
 *   window: number | null}} Estimate
 * @typedef {{parameters: string[], reason: string}} Combination
 * @typedef {{minimum: number, maximum: number}} Limits
 * @typedef {"wls" | "rls" | "ekf"} Method
 * @typedef {{preset: "tuned" | "paper" | "custom", noise_i: number, lsb: number, omega_e: number | null, doubt: number,
 *   warming: number}} Tuning
 * @typedef {{method: Method, length: number | "auto", longest: number, periods_per_row: number, estimated: string[],
 *   held: Record<string, number>, forgetting_factor: number, ekf: Tuning,
 *   limits: {length: Limits, longest: Limits, periods_per_row: Limits, forgetting_factor: Limits}}} Window
 * @typedef {{status: "explained" | "unexplained" | "not_told", since: string | null, until: string | null,
 *   where: string, reason: string, significance: number | null, ratio: number | null, rms_V: number | null,
 *   least_V: number | null}} Mismatch
 * @typedef {{drive: string, method: Method, status: "ok" | "filling" | "doubtful" | "stale" | "no_data",
 *   estimates: Record<string, Estimate>, combinations: Combination[], mismatch: Mismatch, window: Window, samples: number, gaps: number, left_out: number, rows_dropped: number,
 *   drive_state: {state: string | null, fault: Fault | null}, age_s: number | null, t_drive_s: number | null, condition: number | null, residual_rms_V: number | null}} Estimates
 * @typedef {"now" | "command" | {signal: string, level: number, edge: string}} Trigger
 * @typedef {{signals: string[], length: number, decimation: number, trigger?: Trigger, pre_trigger?: number,
 *   timeout_s?: number}} CaptureRequest
 * @typedef {{id: string, drive: string, state: string, progress: number, samples: number, reason: string,
 *   remark: string, file: string | null, asked: string, request: CaptureRequest}} Capture
 * @typedef {{drive: DriveState, estimates: Estimates, capture: Capture | null}} Snapshot
 * @typedef {{drive: string, bin_s: number, first: string, last: string, t_drive_s: number, age_s: number,
 *   signals: Record<string, {unit: string, low: (number | null)[], high: (number | null)[]}>}} Recent
 * @typedef {{t: number, text: string, whom: string, at: string}} Mark
 * @typedef {{id: string, kind: "stream" | "capture" | "experiment" | "file", drive: string,
 *   state: "armed" | "recording" | "closing" | "done" | "failed" | "cancelled", begun: string, rows: number,
 *   seconds: number | null, bytes: number, columns: string[], title: string, note: string, marks: Mark[], gaps: number,
 *   rows_lost: number, whole: boolean, reason: string, continues: string}} Recording
 * @typedef {{recording: Recording | null, bytes_per_day: number | null, free_bytes: number, days: number | null}} RecordingRoom
 * @typedef {{unit: string, t: number[], value: number[], std: (number | null)[], low: number[], high: number[],
 *   status: ("held" | "ok" | "doubtful")[]}} Course
 * @typedef {{span_s: number, parameters: Record<string, Course>}} Past
 * @typedef {Partial<Omit<Window, "limits" | "ekf">> & {ekf?: Partial<Tuning>}} WindowChange
 */

const PATIENCE_MS = 5000;

/** @returns {Promise<DriveState[]>} */
export async function listDrives() {
  return (await call("GET", "/api/drives")).drives;
}

/**
 * @param {string} drive
 * @param {WindowChange} change
 * @returns {Promise<Window>}
 */
export function putWindow(drive, change) {
  return call("PUT", `/api/drives/${encodeURIComponent(drive)}/window`, change);
}

/**
 * @param {string} drive
 * @param {Record<string, number>} setPoints SI
 * @returns {Promise<Control>}
 */
export function startDrive(drive, setPoints) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/start`, setPoints);
}

/** @param {string} drive @returns {Promise<Control>} */
export function stopDrive(drive) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/stop`, {});
}

/** @param {string} drive @returns {Promise<Control>} */
export function resetDrive(drive) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/reset`, {});
}

/**
 * @param {string} drive
 * @param {string[]} names
 * @returns {Promise<{name: string, value: number}[]>} SI
 */
export async function readSignals(drive, names) {
  return (await call("GET", `/api/drives/${encodeURIComponent(drive)}/signals?names=${names.join(",")}`)).signals;
}

/**
 * @param {string} drive
 * @param {Record<string, number>} values SI
 */
export function writeSignals(drive, values) {
  return call("PUT", `/api/drives/${encodeURIComponent(drive)}/signals`, values);
}

/**
 * @param {string} drive
 * @param {number} seconds how far back
 * @returns {Promise<Past>}
 */
export function readPast(drive, seconds) {
  return call("GET", `/api/drives/${encodeURIComponent(drive)}/history?seconds=${seconds}`);
}

/**
 * @param {string} drive
 * @param {CaptureRequest} request
 * @returns {Promise<Capture>}
 */
export function askCapture(drive, request) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/captures`, request);
}

/**
 * @param {string} drive
 * @param {string} id
 * @returns {Promise<Capture>}
 */
export function triggerCapture(drive, id) {
  return call("POST", `${captureAddress(drive, id)}/trigger`);
}

/**
 * @param {string} drive
 * @param {string} id
 * @returns {Promise<Capture>}
 */
export function cancelCapture(drive, id) {
  return call("DELETE", captureAddress(drive, id));
}

/**
 * @param {string} drive
 * @param {string} id
 */
export function captureFile(drive, id) {
  return `${captureAddress(drive, id)}/file`;
}

/**
 * @param {string} drive
 * @param {string} id
 */
function captureAddress(drive, id) {
  return `/api/drives/${encodeURIComponent(drive)}/captures/${encodeURIComponent(id)}`;
}

/** @param {string} drive @returns {Promise<RecordingRoom>} */
export function readRecordingRoom(drive) {
  return call("GET", `/api/drives/${encodeURIComponent(drive)}/recordings`);
}

/** @param {string} drive @param {object} wanted @returns {Promise<Recording>} */
export function askRecording(drive, wanted) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/recordings`, wanted);
}

/** @param {string} id @returns {Promise<Recording>} */
export function endRecording(id) {
  return call("POST", `/api/recordings/${encodeURIComponent(id)}/stop`, {});
}

/** @param {string} id @param {string} text @param {number} [t] s from its begin; left out: now @returns {Promise<Recording>} */
export function markRecording(id, text, t) {
  return call("POST", `/api/recordings/${encodeURIComponent(id)}/marks`, t === undefined ? { text } : { text, t });
}

/** @param {string} drive */
export function streamAddress(drive) {
  return `/api/drives/${encodeURIComponent(drive)}/stream?rows=true`;
}

/** The service did not answer, so whether it did what was asked is not known. */
export class NoAnswerError extends Error {}

/**
 * @param {string} method
 * @param {string} address
 * @param {unknown} [body]
 */
async function call(method, address, body) {
  const response = await send(method, address, body);
  const content = await response.json().catch(() => null);
  if (response.ok && content !== null) return content;
  throw new Error(problemSentence(response, content));
}

/**
 * @param {string} method
 * @param {string} address
 * @param {unknown} body
 */
async function send(method, address, body) {
  try {
    return await fetch(address, {
      method,
      headers: method === "GET" ? {} : { "Content-Type": "application/json" }, // also of what has no body
      body: body === undefined ? undefined : JSON.stringify(body),
      cache: "no-store",
      signal: AbortSignal.timeout(PATIENCE_MS),
    });
  } catch {
    throw new NoAnswerError("The service does not answer.");
  }
}

/**
 * The `detail` of an RFC 9457 problem document, or what can be said without one.
 * @param {Response} response
 * @param {{detail?: unknown} | null} problem
 */
function problemSentence(response, problem) {
  if (problem !== null && typeof problem.detail === "string" && problem.detail !== "") return problem.detail;
  return `The service answered ${response.status} ${response.statusText}`.trim() + " without an explanation.";
}
