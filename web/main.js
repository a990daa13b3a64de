/**
 * The page: joins connection and parts, and sets the pace. Snapshots come at about ten a second; words are written
 * four times, plots drawn twice a second, more than an eye can read.
 *
 * @typedef {import("./api.js").Snapshot} Snapshot
 */

import { hideBanner, showLost, showNotice } from "./panels/banner.js";
import { buildCapturePanel, showCapture, startCapturePanel } from "./panels/capture_panel.js";
import { readPast } from "./api.js";
import { keepConnected } from "./connection.js";
import { buildControlBar, showControl, startControlBar } from "./panels/control_bar.js";
import { onDriveChosen, showDrive, showDrives } from "./panels/header.js";
import { History, MEMORY_S } from "./history.js";
import { PARAMETERS } from "./parameters.js";
import { buildPlots, drawPlot, spanFor } from "./panels/plots.js";
import { buildTiles, clearTiles, exponentOf, showEstimates } from "./panels/tiles.js";
import { buildWindowForm, showWindow, startWindowForm } from "./panels/window_form.js";

const WORDS_MS = 250;
const PLOTS_MS = 500;
const PAST_MS = 60_000;

const state = {
  /** @type {string | null} */ drive: null,
  /** @type {Snapshot | null} */ snapshot: null,
  /** @type {Map<string, History>} */ histories: new Map(),
  received: 0,
  connected: false,
  span_s: 300,
};

/** @param {string | null} name */
function chooseDrive(name) {
  if (name === state.drive) return;
  state.drive = name;
  state.snapshot = null;
  state.histories = new Map(PARAMETERS.map((parameter) => [parameter.name, new History()]));
  clearTiles();
  startWindowForm(name);
  startCapturePanel(name);
  startControlBar(name);
  drawPlots();
  recall();
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
  showControl(snapshot.drive.control, connected);
  showDrive(snapshot.drive, (Date.now() - received) / 1000, connected);
  showEstimates(snapshot.estimates, rate, connected);
  showWindow(snapshot.estimates.window, snapshot.estimates.estimates, rate);
  showCapture(snapshot.capture, snapshot.drive.identity?.T_s ?? 0, connected);
}

function drawPlots() {
  if (document.hidden) return;
  const oldest = Math.min(...[...state.histories.values()].map((history) => history.begin));
  const span_s = spanFor(Math.max(0, Date.now() - oldest) / 1000, state.span_s);
  for (const parameter of PARAMETERS) {
    const history = state.histories.get(parameter.name);
    if (history !== undefined) drawPlot(parameter, history, span_s, exponentOf(parameter.name));
  }
}

/** @param {Snapshot} snapshot */
function remember({ estimates }) {
  if (estimates.status === "stale" || estimates.status === "no_data") return;
  const time = Date.now() - 1000 * (estimates.age_s ?? 0);
  for (const [name, history] of state.histories) history.push(time, estimates.estimates[name]);
}

function start() {
  buildTiles();
  buildPlots();
  buildWindowForm();
  buildCapturePanel();
  buildControlBar();
  const reconnect = keepConnected({
    drives(drives) {
      const wanted = state.drive ?? decodeURIComponent(location.hash.slice(1));
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
    lost(since, sentence) {
      state.connected = false;
      showLost(since, sentence);
      drawWords();
    },
  });
  onDriveChosen((name) => {
    history.replaceState(null, "", `#${encodeURIComponent(name)}`);
    chooseDrive(name);
    reconnect();
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
  setInterval(drawPlots, PLOTS_MS);
  setInterval(recall, PAST_MS);
}

start();
