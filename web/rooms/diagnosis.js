/**
 * The room of diagnoses: what is to be diagnosed, those there are, and the one, or the two, that are chosen.
 *
 * @typedef {import("../api.js").DiagnosisJob} DiagnosisJob
 */

import { listDiagnoses, listRecordings } from "../api.js";
import { onHeardAgain } from "../connection.js";
import { make } from "../dom.js";
import { element } from "../fields.js";
import { clock, counted, parseNumber } from "../format.js";
import { words } from "./quantity.js";
import { address, go } from "../router.js";
import { diagnoseIt, lacking } from "./diagnose_it.js";
import { diagnosisView } from "./diagnosis_view.js";
import { nameOf } from "./recording_name.js";

const REFRESH_MS = 1500;
const GOOD = ["no_mismatch", "explained"];

/** @returns {import("../main.js").RoomPart} */
export function diagnosisRoom() {
  const recording = /** @type {HTMLSelectElement} */ (make("select", { id: "diagnose-recording" }));
  const trust = /** @type {HTMLInputElement} */ (make("input", { id: "diagnose-trust", inputmode: "decimal", value: "10" }));
  const machine = /** @type {HTMLInputElement} */ (make("input", { id: "diagnose-machine", type: "file", accept: ".toml" }));
  const begin = /** @type {HTMLButtonElement} */ (make("button", { type: "submit", class: "primary", id: "diagnose-start" }, "Diagnose"));
  const message = make("p", { class: "form-message", id: "diagnose-message", role: "alert" });
  const list = make("ul", { id: "diagnoses-list", class: "list" });
  const count = make("p", { id: "diagnoses-count", class: "section-note", role: "status" });
  const views = make("div", { class: "side-by-side", id: "diagnoses-shown" });

  element("room-diagnosis").append(
    make("h1", { class: "visually-hidden" }, "Diagnosis"),
    make("div", { class: "split" },
      make("section", { class: "card side", "aria-label": "Diagnoses" },
        make("form", { id: "diagnose-form", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); ask(); } },
          make("label", { for: "diagnose-recording" }, "Recording"), recording,
          make("label", { for: "diagnose-machine" }, "Machine file, in place of the drive's data"), machine,
          make("p", { class: "entry" }, make("label", { for: "diagnose-trust" }, "data sheet within ±"), trust, make("span", { class: "unit" }, "%"), begin),
          message),
        count, list),
      views));

  let drive = "";
  let timer = 0;
  let key = "";
  /** What recordings are called, by their ids. @type {Map<string, string>} */
  let names = new Map();
  /** Ids shown. @type {string[]} */
  let chosen = [];
  /** @type {ReturnType<typeof diagnosisView>[]} */
  let shown = [];

  async function ask() {
    message.textContent = "";
    message.dataset.mood = "";
    try {
      const share = parseNumber(trust.value);
      if (share === null || share <= 0) throw new Error(`Data sheet: expected a number of % above zero, got “${trust.value}”.`);
      if (recording.value === "") throw new Error("There is no recording to diagnose yet: capture one in Live.");
      const each = Object.fromEntries(["R_s", "L_d", "L_q", "psi_f"].map((name) => [name, share / 100]));
      const file = machine.files?.[0];
      await diagnoseIt(recording.value, drive,
        { ...(share === 10 ? {} : { trust: each }), ...(file === undefined ? {} : { nominal: await file.text() }) });
      machine.value = "";
    } catch (error) {
      message.dataset.mood = "bad";
      message.textContent = /** @type {Error} */ (error).message;
    }
  }

  /** Figures of one kind have one scale of colours, where two diagnoses are side by side. */
  function drawTogether() {
    if (!shown.every((view) => view.isSettled())) return;
    const most = new Map();
    for (const { name, z } of shown.flatMap((view) => view.figures())) {
      if (z !== null) most.set(name, { low: Math.min(z.low, most.get(name)?.low ?? z.low), high: Math.max(z.high, most.get(name)?.high ?? z.high) });
    }
    for (const view of shown) view.draw(most);
  }

  async function refresh() {
    const asked = drive;
    try {
      const [jobs, ofDrive, files] = await Promise.all([
        listDiagnoses({ drive: asked }), listRecordings({ drive: asked }), listRecordings({ kind: "file" })]);
      if (asked !== drive) return;
      const recordings = [...ofDrive.recordings, ...files.recordings.filter((one) => one.drive !== asked)];
      names = new Map(recordings.map((one) => [one.id, nameOf(one)]));
      const able = recordings.filter((one) => one.kind !== "stream" && one.state === "done" && lacking(one).length === 0);
      const now = JSON.stringify([jobs, [...names], chosen]);
      if (now === key) return;
      key = now;
      const before = recording.value;
      recording.replaceChildren(...able.map((one) => make("option", { value: one.id }, nameOf(one))));
      if (able.some(({ id }) => id === before)) recording.value = before;
      recording.disabled = able.length === 0;
      count.textContent = jobs.total === 0 ? "None yet. Choose a recording and press Diagnose." : `${counted(jobs.total, "diagnosis", "diagnoses")}, the newest first.`;
      list.replaceChildren(...jobs.diagnoses.map(row));
    } catch (error) {
      key = "";
      count.textContent = /** @type {Error} */ (error).message;
    }
  }

  /** @param {DiagnosisJob} job */
  function row(job) {
    const alone = chosen.length === 1 && job.state === "done" && !chosen.includes(job.id);
    return make("li", {},
      make("a", { href: address("diagnosis", drive, job.id), "aria-current": chosen.includes(job.id) && "true" },
        make("span", { class: "row-head" }, make("strong", {}, clock(job.asked)),
          make("span", { class: `chip ${job.verdict !== null && GOOD.includes(job.verdict) ? "good" : "warn"}` }, words(job.verdict ?? job.state))),
        make("span", { class: "row-facts" }, names.get(job.recording) ?? job.recording)),
      alone && make("button", { type: "button", class: "small beside", onclick: () => go("diagnosis", drive, `${chosen[0]}+${job.id}`) }, "lay beside"));
  }

  onHeardAgain(() => { message.textContent = ""; });

  return {
    enter(name, id) {
      drive = name;
      chosen = id === null ? [] : id.split("+").slice(0, 2);
      shown.forEach((view) => view.leave());
      shown = chosen.map((one) => diagnosisView(one, drive, chosen.find((other) => other !== one) ?? null, drawTogether));
      views.replaceChildren(...(shown.length > 0 ? shown.map(({ root }) => root)
        : [make("section", { class: "card padded" }, make("p", { class: "empty" },
          "A diagnosis says which physics a recording shows that the machine's data leave out, where it acts, and how large it is. Choose one, or a recording to diagnose."))]));
      key = "";
      clearInterval(timer);
      timer = setInterval(() => { if (!document.hidden) refresh(); }, REFRESH_MS);
      refresh();
    },
    leave() {
      clearInterval(timer);
      shown.forEach((view) => view.leave());
      shown = [];
      views.replaceChildren();
    },
  };
}
