/**
 * The page: joins connection, bar and rooms, and sets the pace. Snapshots and rows come at about ten a second; words are
 * written four times, plots drawn twice to four times a second, more than an eye can read, and only in the room shown.
 *
 * @typedef {import("./api.js").Snapshot} Snapshot
 */

import { hideBanner, showLost, showNotice } from "./panels/banner.js";
import { buildCapturePanel, showCapture, startCapturePanel } from "./panels/capture_panel.js";
import { readPast } from "./api.js";
import { keepConnected } from "./connection.js";
import { buildControlBar, showControl, startControlBar } from "./panels/control_bar.js";
import { onDriveChosen, showDrive, showDrives } from "./panels/header.js";
import { History, MEMORY_S } from "./panels/history.js";
import { PARAMETERS } from "./parameters.js";
import { buildPlots, drawPlot, spanFor } from "./panels/plots.js";
import { RecentRows } from "./panels/recent.js";
import { buildRecordPanel, lookForRecording, startRecordPanel } from "./panels/record_panel.js";
import { buildStrips, drawStrips, startStrips } from "./panels/strips.js";
import { buildShaft, showShaft } from "./panels/shaft.js";
import { buildTiles, clearTiles, exponentOf, showEstimates } from "./panels/tiles.js";
import { drawVector, startVector } from "./panels/vector.js";
import { buildWindowForm, showWindow, startWindowForm } from "./panels/window_form.js";
import { ROOMS, address, onPlace, place, settle } from "./router.js";
import { diagnosisRoom } from "./rooms/diagnosis.js";
import { driveRoom } from "./rooms/drive.js";
import { recordingsRoom } from "./rooms/recordings.js";

/**
 * A room but for the live one: entered with the drive and what of it is shown; left when another is entered; shown how the
 * drive is, where it wants to be.
 * @typedef {{enter: (drive: string, id: string | null) => void, leave: () => void,
 *   show?: (drive: import("./api.js").DriveState, connected: boolean) => void}} RoomPart
 */

const WORDS_MS = 250;
const STRIPS_MS = 250;
const PLOTS_MS = 500;
const PAST_MS = 60_000;
const RECORDING_MS = 1000;

/** @type {Record<string, RoomPart>} */
const parts = { recordings: recordingsRoom(), diagnosis: diagnosisRoom(), drive: driveRoom() };

const state = {
  /** @type {string | null} */ drive: null,
  /** @type {Snapshot | null} */ snapshot: null,
  /** @type {Map<string, History>} */ histories: new Map(),
  rows: new RecentRows(),
  received: 0,
  connected: false,
  span_s: 300,
  /** @type {import("./router.js").Place | null} */ shown: null,
};

/** @param {string | null} name */
function chooseDrive(name) {
  if (name === state.drive) return;
  state.drive = name;
  state.snapshot = null;
  state.histories = new Map(PARAMETERS.map((parameter) => [parameter.name, new History()]));
  state.rows = new RecentRows();
  clearTiles();
  showShaft(null, true);
  startWindowForm(name);
  startCapturePanel(name);
  startControlBar(name);
  startRecordPanel(name);
  startStrips();
  startVector();
  showPlace();
  drawPlots();
  recall();
}

/** Shows the room that the address names. */
function showPlace() {
  const { drive } = state;
  const now = { ...place(), drive };
  for (const room of ROOMS) {
    const section = document.getElementById(`room-${room}`);
    if (section !== null) section.hidden = room !== now.room;
    const link = document.querySelector(`nav [data-room="${room}"]`);
    link?.setAttribute("href", address(room, drive));
    if (room === now.room) link?.setAttribute("aria-current", "page");
    else link?.removeAttribute("aria-current");
  }
  const before = state.shown;
  if (before !== null && before.room === now.room && before.drive === now.drive && before.id === now.id) return;
  if (before !== null) parts[before.room]?.leave();
  if (before !== null && before.room !== now.room) window.scrollTo(0, 0);
  state.shown = now;
  if (drive === null) return;
  settle(now);
  parts[now.room]?.enter(drive, now.id);
  drawWords();
  drawPlots();
  drawStripsNow();
}

/** What the service remembers of the time shown; where it has no catalogue, what has come since stands alone. */
async function recall() {
  const { drive, histories, span_s } = state;
  if (drive === null) return;
  try {
    const past = await readPast(drive, Math.max(span_s, MEMORY_S));
    if (state.histories !== histories || state.span_s !== span_s) return;
    for (const [name, history] of histories) history.recall(past.parameters[name], past.span_s);
    drawPlots();
  } catch { /* told by the service's health */ }
}

function drawWords() {
  const { snapshot, received, connected } = state;
  if (snapshot === null) return;
  const rate = snapshot.drive.stream.nominal_rate_hz ?? snapshot.drive.stream.rate_hz;
  showControl(snapshot.drive.control, connected, snapshot.drive.limits);
  showDrive(snapshot.drive, (Date.now() - received) / 1000, connected);
  parts[state.shown?.room ?? ""]?.show?.(snapshot.drive, connected);
  showEstimates(snapshot.estimates, rate, connected);
  showShaft(snapshot.estimates.mechanics, connected);
  showWindow(snapshot.estimates.window, snapshot.estimates.estimates, rate);
  showCapture(snapshot.capture, snapshot.drive.identity?.T_s ?? 0, connected);
}

/** Whether anybody can see the plots of the live room. */
function live() {
  return !document.hidden && state.shown?.room === "live";
}

function drawPlots() {
  if (!live()) return;
  const oldest = Math.min(...[...state.histories.values()].map((history) => history.begin));
  const span_s = spanFor(Math.max(0, Date.now() - oldest) / 1000, state.span_s);
  for (const parameter of PARAMETERS) {
    const history = state.histories.get(parameter.name);
    if (history !== undefined) drawPlot(parameter, history, span_s, exponentOf(parameter.name));
  }
}

function drawStripsNow() {
  const { snapshot, rows, connected } = state;
  if (!live()) return;
  const limits = snapshot?.drive.limits;
  const old = !connected || (snapshot?.drive.latest ?? null) === null;
  drawStrips(rows, limits?.n_p ?? null);
  drawVector(snapshot?.drive.latest ?? null, rows, limits?.i_max ?? null, old);
}

/** @param {Snapshot} snapshot */
function remember({ drive, estimates }) {
  state.rows.takeTemperatures(Date.now(), drive.latest);
  if (estimates.status === "stale" || estimates.status === "no_data") return;
  const time = Date.now() - 1000 * (estimates.age_s ?? 0);
  for (const [name, history] of state.histories) history.push(time, estimates.estimates[name]);
}

function start() {
  buildTiles();
  buildPlots();
  buildStrips();
  buildShaft();
  buildWindowForm();
  buildCapturePanel();
  buildRecordPanel();
  buildControlBar();
  const reconnect = keepConnected({
    drives(drives) {
      const wanted = state.drive ?? place().drive;
      const name = (drives.find((drive) => drive.name === wanted) ?? drives[0])?.name ?? null;
      chooseDrive(name);
      showDrives(drives, name);
      if (name === null) showNotice("The service is running but has no drive in its configuration.");
      return name;
    },
    snapshot(snapshot) {
      const first = state.snapshot === null || !state.connected;
      Object.assign(state, { snapshot, received: Date.now(), connected: true });
      remember(snapshot);
      if (first) { hideBanner(); drawWords(); }
    },
    rows(rows) {
      if (rows.drive === state.drive) state.rows.take(rows);
    },
    lost(since, sentence) {
      state.connected = false;
      showLost(since, sentence);
      drawWords();
    },
  });
  onDriveChosen((name) => {
    settle({ room: place().room, drive: name, id: null });
    chooseDrive(name);
    reconnect();
  });
  onPlace((now) => {
    if (now.drive !== null && now.drive !== state.drive && state.drive !== null) {
      chooseDrive(now.drive);
      reconnect();
    } else showPlace();
  });
  document.getElementById("span-choice")?.addEventListener("change", (event) => {
    state.span_s = Number(/** @type {HTMLInputElement} */ (event.target).value);
    drawPlots();
    recall();
  });
  for (const [event, printing] of [["beforeprint", true], ["afterprint", false]]) {
    window.addEventListener(String(event), () => {
      document.documentElement.classList.toggle("printing", Boolean(printing));
      drawPlots();
    });
  }
  setInterval(drawWords, WORDS_MS);
  setInterval(drawStripsNow, STRIPS_MS);
  setInterval(drawPlots, PLOTS_MS);
  setInterval(recall, PAST_MS);
  setInterval(() => { if (!document.hidden && state.connected) lookForRecording(); }, RECORDING_MS);
  showPlace();
}

start();
