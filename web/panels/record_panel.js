/**
 * The panel that records the drive's stream: begin, mark, end; how large it is, and for how long there is room. What
 * is under way is told in the bar, too, in every room.
 *
 * @typedef {import("../api.js").Recording} Recording
 * @typedef {import("../api.js").RecordingRoom} RecordingRoom
 */

import { askRecording, endRecording, markRecording, NoAnswerError, readRecordingRoom } from "../api.js";
import { onHeardAgain } from "../connection.js";
import { make } from "../dom.js";
import { element, input, number, write } from "../fields.js";
import { bytes, counted, duration, integer } from "../format.js";
import { address } from "../router.js";

const form = /** @type {HTMLFormElement} */ (element("record-form"));
const [start, end, mark] = ["record-start", "record-stop", "record-mark"].map((id) => /** @type {HTMLButtonElement} */ (element(id)));
const words = element("record-words");
const bar = element("bar-recording");

/** @type {string | null} */
let drive = null;
/** @type {Recording | null} */
let running = null;
/** The one that ended last while this page was open. @type {Recording | null} */
let ended = null;
let refusal = "";
let unanswered = false;

export function buildRecordPanel() {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    ask(async (name) => { ended = null; await askRecording(name, wanted()); });
  });
  end.addEventListener("click", () => ask(async () => { if (running !== null) await endRecording(running.id); }));
  mark.addEventListener("click", () => ask(async () => {
    if (running === null) return;
    await markRecording(running.id, input("record-mark-text").value.trim() || "mark");
    input("record-mark-text").value = "";
  }));
  input("record-mark-text").addEventListener("keydown", (event) => {
    if (event.key === "Enter") { event.preventDefault(); mark.click(); }
  });
  onHeardAgain(() => { if (unanswered) refusal = ""; });
}

/** Forgets a drive, as when another is chosen. @param {string | null} name */
export function startRecordPanel(name) {
  drive = name;
  running = null;
  ended = null;
  refusal = "";
  lookForRecording();
}

/** Asks what is being recorded, and for how long there is room. */
export async function lookForRecording() {
  const asked = drive;
  if (asked === null) return;
  try {
    const room = await readRecordingRoom(asked);
    if (asked !== drive) return;
    if (running !== null && room.recording?.id !== running.id) ended = running;
    running = room.recording;
    write(element("record-room"), roomWords(room));
  } catch { /* the banner says that the service is gone */ }
  show();
}

function show() {
  const state = running?.state ?? "";
  start.disabled = running !== null;
  start.title = running === null ? "" : "A recording of this drive is under way.";
  end.hidden = running === null || state === "closing";
  element("record-mark-entry").hidden = state !== "recording";
  bar.hidden = running === null;
  if (running === null) {
    words.replaceChildren(...(ended === null || drive === null ? [] : ["Recorded. ",
      make("a", { href: address("recordings", drive, ended.id) }, "Look at it")]));
  } else {
    const told = `${stateWords(running)}: ${duration(running.seconds ?? 0)}, ${integer(running.rows)} rows, ${bytes(running.bytes)}`
      + (running.marks.length > 0 ? `, ${counted(running.marks.length, "mark")}` : "") + (running.gaps > 0 ? `, ${counted(running.gaps, "gap")}` : "");
    write(words, told);
    write(bar, `● ${state} ${duration(running.seconds ?? 0)}`);
  }
  const message = element("record-message");
  message.dataset.mood = refusal === "" ? "" : "bad";
  write(message, refusal);
}

/** @param {Recording} recording */
function stateWords({ state, reason }) {
  if (state === "armed") return `Armed${reason === "" ? "" : `, ${reason}`}`;
  return state === "closing" ? "Being closed" : "Recording";
}

/** @param {RecordingRoom} room */
function roomWords({ bytes_per_day, days, free_bytes }) {
  if (bytes_per_day === null || days === null) return `${bytes(free_bytes)} of disk can be used.`;
  const long = days > 400 ? "more than a year" : days >= 2 ? `${Math.floor(days)} days` : duration(86_400 * days);
  return `A day takes at most ${bytes(bytes_per_day)}; there is room for ${long}.`;
}

/** @param {(drive: string) => Promise<void>} request */
async function ask(request) {
  refusal = "";
  try {
    if (drive === null) throw new Error("No drive to record.");
    await request(drive);
  } catch (error) {
    const { message } = /** @type {Error} */ (error);
    unanswered = error instanceof NoAnswerError;
    refusal = unanswered ? `${message} Whether it was taken is not known.` : message;
  }
  await lookForRecording();
}

/** What to record, in the service's words. */
function wanted() {
  /** @type {Record<string, unknown>} */
  const body = { title: input("record-title-text").value.trim() };
  if (input("record-seconds").value.trim() !== "") body.seconds = number(input("record-seconds"), "Ends after");
  const trigger = input("record-trigger").value.trim();
  if (trigger !== "") body.trigger = trigger;
  return body;
}
