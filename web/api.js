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
 * @typedef {{name: string, unit: string, before: number, after: number}} FlashedValue
 * @typedef {{drive: string, name: string, version: number, whom: string, since: string, override: string,
 *   changed: FlashedValue[]}} CutFlash
 * @typedef {CutFlash & {ended: string, state: "flashed" | "rolled back", said: string}} PastFlash
 * @typedef {{id: string, state: "running" | "flashed" | "rolled back" | "cut", name: string, version: number, phase: string,
 *   progress: number, steps: {at: string, said: string}[], said: string, changed: FlashedValue[]}} Flash
 * @typedef {{flashes: Flash[], past: PastFlash[], total: number, cut: CutFlash | null}} Flashes
 * @typedef {{value: number, unit: string}} ParameterEntry
 * @typedef {{name: string, entries: Record<string, ParameterEntry>}} ParameterSet
 * @typedef {{signal: string, unit: string, old: number, new: number, held: number, rounding: number, bits_old: string,
 *   bits_new: string}} PlannedChange
 * @typedef {{changes: PlannedChange[], same: number, problems: string[], doubts: string[], remarks: string[]}} Plan
 * @typedef {{name: string, url: string, identity: Identity | null, link: Link, stream: Stream, latest: Latest | null,
 *   limits: SetPointLimits, writer: Writer | null, control: Control, cut_flash: CutFlash | null}} DriveState
 * @typedef {{code: string, name: string, advice: string}} Fault
 * @typedef {{state: string | null, fault: Fault | null, holder: string | null, lease_left_s: number | null,
 *   ours: boolean, whom: string | null, in_experiment: boolean, in_flash: boolean, said: string, undone: string, guarded: boolean | null,
 *   safe_torque_off: string | null, seen: string | null}} Control
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
 * @typedef {{status: "ok" | "doubtful" | "no_acceleration" | "not_told" | "no_data" | "stale", since: string | null,
 *   sentence: string, estimates: Record<string, Estimate>, sum: Estimate | null, direction: -1 | 0 | 1}} Mechanics
 * @typedef {{drive: string, method: Method, status: "ok" | "filling" | "doubtful" | "stale" | "no_data",
 *   estimates: Record<string, Estimate>, combinations: Combination[], mismatch: Mismatch, mechanics: Mechanics, window: Window, samples: number, gaps: number, left_out: number, rows_dropped: number,
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
 * @typedef {{id: string, recording: string, recording_there: boolean, drive: string,
 *   state: "queued" | "running" | "done" | "failed" | "cancelled", progress: number, phase: string, reason: string, asked: string,
 *   verdict: string | null, sentence: string | null, request: object, remark: string}} DiagnosisJob
 * @typedef {import("./rooms/quantity.js").Quantity} Quantity
 * @typedef {{sentence: string}} Place
 * @typedef {{speed_rpm: number, i_d: number, i_q: number, seconds: number}} Hold
 * @typedef {{sentence: string, holds: Hold[], step: number}} Experiment
 * @typedef {{id: string, state: "running" | "done" | "failed" | "cancelled", phase: string, progress: number, reason: string,
 *   remarks: string[], file: string | null}} ExperimentRun
 * @typedef {{id: string, drive: string, state: "running" | "done" | "failed" | "cancelled", phase: string,
 *   steps: {at: string, said: string}[], reason: string, asked: string, request: {kind: "first_start" | "identify" | "verify"},
 *   result: {said?: string, diagnosis?: {verdict: string, sentence: string}, set?: string, remarks?: string[]}}} Commissioning
 * @typedef {{effects: string[], rivals: boolean, machine_holds: boolean, reason: string, experiment: Experiment}} Doubt
 * @typedef {{verdict: string, sentence: string,
 *   findings: {effect: string, parameters: Record<string, Quantity>, where: Place, odds_against_next: number}[],
 *   ambiguous: Doubt[], unexplained: {rms_V: number, where: Place, description: string} | null,
 *   experiment: Experiment | null, remarks: string[],
 *   machine: {nominal: Record<string, number>, before: Record<string, Quantity>, after: Record<string, Quantity>},
 *   fit: {held_out: boolean, one_step_rms_V: {before: number, after: number, noise_floor: number | null},
 *     free_run_rms_A: {before: number, after: number}, explained: number | null, leave_one_out: object | null} | null}} Diagnosis
 * @typedef {{at: string, kind: string, sentence: string,
 *   write: {before: Record<string, unknown> | null, after: Record<string, unknown> | null} | null, lease: {ended: string | null, how: string} | null}} DriveEvent
 * @typedef {{recordings: Recording[], total: number, next: string | null}} Recordings
 * @typedef {{unit: string, low: (number | null)[], mean: (number | null)[], high: (number | null)[]}} Spread
 * @typedef {{id: string, since: number, until: number, rows: number, thinned: boolean, t: number[],
 *   signals: Record<string, Spread>}} Samples
 * @typedef {{recording: Recording | null, bytes_per_day: number | null, free_bytes: number, days: number | null}} RecordingRoom
 * @typedef {{unit: string, t: number[], value: number[], std: (number | null)[], low: number[], high: number[],
 *   status: ("held" | "ok" | "doubtful")[]}} Course
 * @typedef {{span_s: number, parameters: Record<string, Course>}} Past
 * @typedef {Partial<Omit<Window, "limits" | "ekf">> & {ekf?: Partial<Tuning>}} WindowChange
 */

const PATIENCE_MS = 5000;
/** Of a long recording, what is asked for first is worked on for some seconds. */
const PATIENCE_READING_MS = 60_000;
const PATIENCE_BRINGING_MS = 600_000;
/** A job that moves a drive ends within 5 s, and is waited for. */
const PATIENCE_ENDING_MS = 8000;

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

/** @param {string} drive @returns {Promise<import("./rooms/signals_view.js").Signal[]>} */
export async function readAllSignals(drive) {
  return (await call("GET", `/api/drives/${encodeURIComponent(drive)}/signals`, undefined, PATIENCE_READING_MS)).signals;
}

/** @param {string} drive @returns {Promise<ParameterSet>} */
export function readParameterSet(drive) {
  return call("GET", parameterFile(drive, "json"), undefined, PATIENCE_READING_MS);
}

/** @param {string} drive @param {"json" | "toml"} form */
export function parameterFile(drive, form) {
  return `/api/drives/${encodeURIComponent(drive)}/parameters/set?form=${form}`;
}

/** @param {string} drive @param {object | string} set a text is TOML @returns {Promise<Plan>} */
export function planSet(drive, set) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/parameters/plan`, set, PATIENCE_READING_MS);
}

/** @param {string} drive @param {string} [before] when a past flash began; left out: the latest @returns {Promise<Plan>} */
export function planRollback(drive, before) {
  const query = before === undefined ? "" : `?${new URLSearchParams({ before })}`;
  return call("GET", `/api/drives/${encodeURIComponent(drive)}/parameters/rollback${query}`, undefined, PATIENCE_READING_MS);
}

/** @param {string} drive @param {object | string} set a text is TOML @param {string} reason @returns {Promise<Flash>} */
export function askFlash(drive, set, reason) {
  const because = reason === "" ? "" : `?${new URLSearchParams({ override: reason })}`;
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/flashes${because}`, set, PATIENCE_READING_MS);
}

/** @param {string} drive @param {string} [before] as of `planRollback` @returns {Promise<Flash>} */
export function askRollback(drive, before) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/parameters/rollback`, { before }, PATIENCE_READING_MS);
}

/** @param {string} drive @param {boolean} finish @returns {Promise<Flash>} */
export function askResume(drive, finish) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/parameters/resume`, { finish }, PATIENCE_READING_MS);
}

/** @param {string} drive @returns {Promise<Flashes>} */
export function listFlashes(drive) {
  return call("GET", `/api/drives/${encodeURIComponent(drive)}/flashes`);
}

/** @param {string} drive @param {string} id @returns {Promise<Flash>} */
export function readFlash(drive, id) {
  return call("GET", `/api/drives/${encodeURIComponent(drive)}/flashes/${encodeURIComponent(id)}`);
}

/**
 * @param {string} drive
 * @param {string} kind
 * @param {string} [before]
 * @returns {Promise<{events: DriveEvent[], total: number, next: string | null}>}
 */
export function listEvents(drive, kind, before = "") {
  const wanted = Object.entries({ kind, before }).filter(([, value]) => value !== "");
  return call("GET", `/api/drives/${encodeURIComponent(drive)}/events?${new URLSearchParams(wanted)}`);
}

/**
 * @param {string} drive
 * @param {Record<string, number>} values SI
 * @returns {Promise<{signals: import("./rooms/signals_view.js").Signal[]}>} as they were read back
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

/** @param {{drive?: string, kind?: string, text?: string, before?: string}} wanted @returns {Promise<Recordings>} */
export function listRecordings(wanted) {
  return call("GET", `/api/recordings?${new URLSearchParams(Object.entries(wanted).filter(([, value]) => value !== ""))}`);
}

/**
 * @param {File} file
 * @param {Record<string, string>} said of its columns
 * @returns {Promise<Recording>}
 */
export function bringRecording(file, said) {
  const wanted = Object.entries({ name: file.name, ...said }).filter(([, value]) => value !== "");
  return call("POST", `/api/recordings?${new URLSearchParams(wanted)}`, file, PATIENCE_BRINGING_MS);
}

/** @param {string} id @returns {Promise<Recording>} */
export function readRecording(id) {
  return call("GET", recordingAddress(id));
}

/** @param {string} id @param {{title?: string, note?: string}} said @returns {Promise<Recording>} */
export function annotateRecording(id, said) {
  return call("PATCH", recordingAddress(id), said);
}

/** @param {string} id @returns {Promise<Recording>} */
export function deleteRecording(id) {
  return call("DELETE", recordingAddress(id));
}

/** @param {string} id @param {string} format */
export function recordingFile(id, format) {
  return `${recordingAddress(id)}/file?format=${format}`;
}

/**
 * @param {string} id
 * @param {string[]} signals
 * @param {[number, number] | null} range in s; null: all of it
 * @param {number} points
 * @returns {Promise<Samples>}
 */
export function readSamples(id, signals, range, points) {
  const within = range === null ? "" : `&since=${range[0]}&until=${range[1]}`;
  return call("GET", `${recordingAddress(id)}/samples?signals=${signals.map(encodeURIComponent).join(",")}&points=${points}${within}`,
    undefined, PATIENCE_READING_MS);
}

/** @param {string} id @param {object} request @returns {Promise<DiagnosisJob>} */
export function askDiagnosis(id, request) {
  return call("POST", `${recordingAddress(id)}/diagnosis`, request);
}

/** @param {string} id of the recording @returns {Promise<DiagnosisJob>} */
export function readLatestDiagnosis(id) {
  return call("GET", `${recordingAddress(id)}/diagnosis`);
}

/** @param {{drive?: string, recording?: string}} wanted @returns {Promise<{diagnoses: DiagnosisJob[], total: number, next: string | null}>} */
export function listDiagnoses(wanted) {
  return call("GET", `/api/diagnoses?${new URLSearchParams(wanted)}`);
}

/** @param {string} id @returns {Promise<DiagnosisJob>} */
export function readDiagnosis(id) {
  return call("GET", `/api/diagnoses/${encodeURIComponent(id)}`);
}

/** @param {string} id @returns {Promise<Diagnosis>} */
export function readDiagnosisResult(id) {
  return call("GET", diagnosisFile(id, "result"));
}

/** @param {string} id @returns {Promise<{figures: import("./rooms/figures.js").Figure[]}>} */
export function readDiagnosisFigures(id) {
  return call("GET", diagnosisFile(id, "figures"));
}

/** @param {string} id @param {"result" | "figures" | "report.html" | "machine.toml"} what */
export function diagnosisFile(id, what) {
  return `/api/diagnoses/${encodeURIComponent(id)}/${what}`;
}

/** Cancels one that is under way, deletes one that has ended. @param {string} id @returns {Promise<DiagnosisJob>} */
export function removeDiagnosis(id) {
  return call("DELETE", `/api/diagnoses/${encodeURIComponent(id)}`);
}

/** @param {string} drive @param {object} wanted @returns {Promise<ExperimentRun>} */
export function askExperiment(drive, wanted) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/experiments`, wanted);
}

/** @param {string} drive @param {string} id @returns {Promise<ExperimentRun>} */
export function readExperiment(drive, id) {
  return call("GET", `/api/drives/${encodeURIComponent(drive)}/experiments/${encodeURIComponent(id)}`);
}

/** @param {string} drive @param {string} id @returns {Promise<ExperimentRun>} */
export function cancelExperiment(drive, id) {
  return call("DELETE", `/api/drives/${encodeURIComponent(drive)}/experiments/${encodeURIComponent(id)}`);
}

/** @param {string} drive @param {object} wanted @returns {Promise<Commissioning>} */
export function askCommissioning(drive, wanted) {
  return call("POST", `/api/drives/${encodeURIComponent(drive)}/commissionings`, wanted);
}

/** @param {string} drive @returns {Promise<Commissioning[]>} the newest first */
export async function listCommissionings(drive) {
  return (await call("GET", `/api/drives/${encodeURIComponent(drive)}/commissionings`)).commissionings;
}

/** @param {string} drive @param {string} id @returns {Promise<Commissioning>} */
export function readCommissioning(drive, id) {
  return call("GET", commissioningAddress(drive, id));
}

/** @param {string} drive @param {string} id @returns {Promise<Commissioning>} */
export function cancelCommissioning(drive, id) {
  return call("DELETE", commissioningAddress(drive, id), undefined, PATIENCE_ENDING_MS);
}

/** @param {string} drive @param {string} id */
export function commissioningReport(drive, id) {
  return `${commissioningAddress(drive, id)}/report.html`;
}

/** @param {string} drive @param {string} id */
function commissioningAddress(drive, id) {
  return `/api/drives/${encodeURIComponent(drive)}/commissionings/${encodeURIComponent(id)}`;
}

/** @param {string} id */
function recordingAddress(id) {
  return `/api/recordings/${encodeURIComponent(id)}`;
}

/** @param {string} drive */
export function streamAddress(drive) {
  return `/api/drives/${encodeURIComponent(drive)}/stream?rows=true`;
}

/** The service did not answer, so whether it did what was asked is not known. */
export class NoAnswerError extends Error {}

/** The service answered, and told of nothing of that name. */
export class NotThereError extends Error {}

/**
 * @param {string} method
 * @param {string} address
 * @param {unknown} [body]
 * @param {number} [patience_ms]
 */
async function call(method, address, body, patience_ms = PATIENCE_MS) {
  const response = await send(method, address, body, patience_ms);
  const content = await response.json().catch(() => null);
  if (response.ok && content !== null) return content;
  const sentence = problemSentence(response, content);
  throw response.status === 404 ? new NotThereError(sentence) : new Error(sentence);
}

/**
 * @param {string} method
 * @param {string} address
 * @param {unknown} body
 * @param {number} patience_ms
 */
async function send(method, address, body, patience_ms) {
  try {
    return await fetch(address, {
      method,
      headers: method === "GET" ? {} : { "Content-Type": mediaOf(body) },
      body: body === undefined || body instanceof Blob || typeof body === "string" ? body : JSON.stringify(body),
      cache: "no-store",
      signal: AbortSignal.timeout(patience_ms),
    });
  } catch {
    throw new NoAnswerError("The service does not answer.");
  }
}

/** JSON also of what has no body. @param {unknown} body */
function mediaOf(body) {
  return body instanceof Blob ? "application/octet-stream" : typeof body === "string" ? "application/toml" : "application/json";
}

/**
 * The `problems` of an RFC 9457 problem document, a line each, its `detail`, or what can be said without one.
 * @param {Response} response
 * @param {{detail?: unknown, problems?: unknown} | null} problem
 */
function problemSentence(response, problem) {
  if (problem !== null && Array.isArray(problem.problems)) return problem.problems.join("\n");
  if (problem !== null && typeof problem.detail === "string" && problem.detail !== "") return problem.detail;
  return `The service answered ${response.status} ${response.statusText}`.trim() + " without an explanation.";
}
