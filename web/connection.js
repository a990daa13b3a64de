/**
 * The page's connection to the service: the drive list, then one event stream. Whatever breaks, it says since when
 * and tries again from the list, for a restarted service may have other drives.
 *
 * @typedef {import("./api.js").DriveState} DriveState
 * @typedef {import("./api.js").Snapshot} Snapshot
 * @typedef {object} Listener
 * @property {(drives: DriveState[]) => string | null} drives is given the list, answers the drive to follow
 * @property {(snapshot: Snapshot) => void} snapshot
 * @property {(rows: import("./api.js").Recent) => void} rows
 * @property {(since: Date, sentence: string) => void} lost
 */

import { listDrives, streamAddress } from "./api.js";

const RETRY_MS = 1000;
const SILENCE_MS = 1500;

/** @type {(() => void)[]} */
const listeners = [];

/** @param {() => void} listener is told that the service is heard again: what was not answered before is over */
export function onHeardAgain(listener) {
  listeners.push(listener);
}

/**
 * Opens the connection and keeps it. Calling the returned function starts again, as after the choice of another drive.
 * @param {Listener} listener
 * @returns {() => void}
 */
export function keepConnected(listener) {
  /** @type {EventSource | null} */
  let source = null;
  let attempt = 0;
  let timer = 0;
  let opened = Date.now();
  let heard = Date.now();
  let silent = false;

  function close() {
    source?.close();
    source = null;
    clearTimeout(timer);
  }

  /** @param {string} sentence */
  function lose(sentence) {
    close();
    silent = true;
    listener.lost(new Date(heard), sentence);
    timer = setTimeout(open, RETRY_MS);
  }

  async function open() {
    close();
    const mine = ++attempt;
    try {
      const drives = await listDrives();
      if (mine !== attempt) return;
      const name = listener.drives(drives);
      if (name === null) timer = setTimeout(open, RETRY_MS);
      else follow(name);
    } catch (error) {
      if (mine === attempt) lose(/** @type {Error} */ (error).message);
    }
  }

  /** @param {string} name */
  function follow(name) {
    opened = Date.now();
    source = new EventSource(streamAddress(name));
    source.addEventListener("snapshot", (event) => {
      heard = Date.now();
      listener.snapshot(JSON.parse(event.data));
      if (silent) for (const again of listeners) again();
      silent = false;
    });
    source.addEventListener("rows", (event) => listener.rows(JSON.parse(event.data)));
    source.addEventListener("error", () => lose("The stream of measurements broke off."));
  }

  setInterval(() => {
    if (source !== null && Date.now() - Math.max(heard, opened) > SILENCE_MS) {
      lose(`No measurement came for ${SILENCE_MS / 1000} s.`);
    }
  }, 250);
  window.addEventListener("pagehide", close);
  window.addEventListener("pageshow", (event) => { if (event.persisted) open(); });
  open();
  return open;
}
