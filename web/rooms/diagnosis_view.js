/**
 * One diagnosis: how far it is, then verdict, sentence, what was left out and where, before and after, the experiment
 * that would tell - which is run from here - and the pictures.
 *
 * @typedef {import("../api.js").DiagnosisJob} DiagnosisJob
 * @typedef {import("../api.js").Diagnosis} Diagnosis
 * @typedef {import("../api.js").Experiment} Experiment
 * @typedef {import("./figures.js").Scales} Scales
 */

import { NoAnswerError, askExperiment, cancelExperiment, diagnosisFile, readDiagnosis, readDiagnosisFigures, readDiagnosisResult, readExperiment,
  readRecording, removeDiagnosis, stopDrive } from "../api.js";
import { confirmed } from "../dialog.js";
import { make } from "../dom.js";
import { clock, duration, plain } from "../format.js";
import { oddsText, quantityText, sentenceCase, words } from "./quantity.js";
import { address, go } from "../router.js";
import { diagnoseIt } from "./diagnose_it.js";
import { figureElement } from "./figures.js";
import { HOW_ZOOMED } from "../plot.js";
import { nameOf } from "./recording_name.js";

const POLL_MS = 500;
const UNDER_WAY = ["queued", "running"];
const SETTLED = ["no_mismatch", "explained"];
const EACH = { R_s: "ohm", L_d: "H", L_q: "H", psi_f: "Vs" };

/**
 * @param {string} id
 * @param {string} drive
 * @param {string | null} beside another one that is beside it
 * @param {() => void} settled is called once it is known what there is to draw
 */
export function diagnosisView(id, drive, beside, settled) {
  const root = make("section", { class: `card padded view diagnosis${beside === null ? "" : " narrow"}`, "aria-label": `Diagnosis ${id}` });
  let left = false;
  let isSettled = false;
  /** What its recording is called. */
  let called = "";
  let timer = 0;

  /** @param {() => Promise<unknown>} what */
  async function tried(what) {
    try {
      await what();
    } catch (error) {
      root.querySelector(".form-message")?.remove();
      root.append(make("p", { class: "form-message", "data-mood": "bad", role: "alert" }, /** @type {Error} */ (error).message));
    }
  }

  async function look() {
    try {
      const job = await readDiagnosis(id);
      called ||= job.recording_there ? nameOf(await readRecording(job.recording)) : job.recording;
      if (left) return;
      if (UNDER_WAY.includes(job.state)) {
        showProgress(job);
        timer = setTimeout(look, POLL_MS);
      } else if (job.state === "done") await showResult(job);
      else showEnd(job);
    } catch (error) {
      if (left) return;
      root.replaceChildren(make("p", { class: "form-message", "data-mood": "bad" }, /** @type {Error} */ (error).message));
      if (error instanceof NoAnswerError) timer = setTimeout(look, POLL_MS);
    }
  }

  /** @param {DiagnosisJob} job */
  function showProgress(job) {
    const state = job.state === "queued" ? "Waiting for its turn" : sentenceCase(job.phase || "beginning");
    let words_ = root.querySelector(".phase");
    if (words_ === null) {
      root.replaceChildren(heading(job),
        make("progress", { max: 1, value: 0, "aria-label": "progress of the diagnosis" }),
        make("p", { class: "phase", role: "status", id: "diagnosis-phase" }),
        make("div", { class: "actions" }, make("button", { type: "button", id: "diagnosis-cancel", onclick: () => tried(() => removeDiagnosis(id)) }, "Cancel")));
      words_ = root.querySelector(".phase");
    }
    const asked = (Date.now() - Date.parse(job.asked)) / 1000;
    /** @type {HTMLElement} */ (words_).textContent = `${state} …  ${duration(Math.max(0, asked))}`;
    /** @type {HTMLProgressElement} */ (root.querySelector("progress")).value = job.progress;
  }

  /** @param {DiagnosisJob} job */
  function heading(job) {
    return make("header", {},
      beside !== null && make("a", { class: "small close", href: address("diagnosis", drive, beside) }, "Close this one"),
      make("p", { class: "section-note" }, `Asked for ${clock(job.asked)}, of `,
        job.recording_there ? make("a", { href: address("recordings", drive, job.recording) }, called) : `${called}, which has been deleted`));
  }

  /** @param {DiagnosisJob} job */
  function showEnd(job) {
    root.replaceChildren(heading(job), make("p", {}, make("span", { class: "chip warn" }, job.state)),
      make("p", {}, job.reason), tail(job));
    settle();
  }

  /** @param {DiagnosisJob} job */
  async function showResult(job) {
    const [said, drawn] = await Promise.all([readDiagnosisResult(id),
      readDiagnosisFigures(id).catch((/** @type {Error} */ { message }) => ({ figures: [], message }))]);
    if (left) return;
    root.replaceChildren(
      heading(job),
      make("p", {}, make("span", { class: `chip verdict ${SETTLED.includes(said.verdict) ? "good" : "warn"}`, id: "diagnosis-verdict" }, words(said.verdict))),
      make("p", { class: "sentence", id: "diagnosis-sentence" }, said.sentence),
      ...(job.remark === "" ? [] : [make("p", { class: "help warn" }, job.remark)]),
      ...experiments(said),
      ...fit(said), ...findings(said), ...unexplained(said), ...remarks(said),
      ...pictures(drawn.figures), ...("message" in drawn ? [make("p", { class: "help warn" }, drawn.message)] : []),
      ...parameters(said), tail(job));
    figures = drawn.figures;
    settle();
  }

  /** Draws what has a place on the page now. @type {((scales: Scales) => void)[]} */
  let drawing = [];
  /** @type {import("./figures.js").Figure[]} */
  let figures = [];

  function settle() {
    isSettled = true;
    settled();
  }

  /** @param {import("./figures.js").Figure[]} figures */
  function pictures(figures) {
    let title = "";
    drawing = [];
    return figures.flatMap((figure, k) => {
      const [picture, draw] = figureElement(figure, beside !== null);
      drawing.push(draw);
      const again = figure.title === title;
      title = figure.title;
      return again ? [picture] : [make("h3", {}, figure.title), ...(k === 0 ? [make("p", { class: "help" }, `${HOW_ZOOMED} Times are those of the recording's column t.`)] : []), picture];
    });
  }

  /** What would tell, and a button that has it done. @param {Diagnosis} said */
  function experiments(said) {
    const doubts = said.ambiguous.map(({ effects, rivals, reason, experiment }) => ({
      title: `${sentenceCase(effects.map(words).join(rivals ? " or " : " and "))}?`, reason, experiment }));
    if (said.experiment !== null) doubts.push({ title: "What to record instead", reason: "", experiment: said.experiment });
    return doubts.map(({ title, reason, experiment }) => make("div", { class: "doubt" },
      make("h3", {}, title), make("p", {}, reason), make("p", {}, make("strong", {}, "To tell: "), experiment.sentence),
      runner(experiment, said)));
  }

  /** @param {Experiment} experiment @param {Diagnosis} said */
  function runner(experiment, said) {
    if (experiment.holds.length === 0) return make("p", { class: "help" }, "No drive can do this one by itself.");
    const words_ = make("p", { class: "phase", role: "status" });
    const bar = make("progress", { max: 1, value: 0, hidden: true, "aria-label": "progress of the experiment" });
    const cancel = make("button", { type: "button", hidden: true, class: "experiment-cancel" }, "Cancel the experiment");
    const run = make("button", { type: "button", class: "primary experiment-run" }, "Run this experiment");
    const next = make("div", { class: "actions" }, run, cancel);
    run.addEventListener("click", () => tried(async () => {
      const seconds = experiment.holds.reduce((sum, hold) => sum + hold.seconds, 0);
      const fastest = Math.max(...experiment.holds.map((hold) => Math.abs(hold.speed_rpm)));
      const most = Math.max(...experiment.holds.map((hold) => Math.hypot(Math.abs(hold.i_d) + experiment.step, Math.abs(hold.i_q) + experiment.step)));
      const sure = await confirmed(`Run it on ${drive}? The motor will move.`,
        `${experiment.holds.length} levels, ${duration(seconds)} in all, up to ${plain(fastest, 4)} rpm and ${plain(most, 3)} A. `
        + "The drive is stopped first, and at the end, its settings as they were. Stop ends it at any time.", "Run it");
      if (!sure) return;
      await stopDrive(drive);
      const status = await askExperiment(drive, { holds: experiment.holds, step: experiment.step, machine: said.machine.nominal });
      follow(status.id);
    }));

    /** @param {string} experimentId */
    async function follow(experimentId) {
      run.hidden = true;
      bar.hidden = false;
      cancel.hidden = false;
      cancel.onclick = () => tried(() => cancelExperiment(drive, experimentId));
      for (;;) {
        const status = await readExperiment(drive, experimentId).catch(() => null);
        if (left) return;
        if (status !== null) {
          /** @type {HTMLProgressElement} */ (bar).value = status.progress;
          words_.textContent = status.state === "running" ? `${sentenceCase(status.phase)} …` : `${sentenceCase(status.state)}. ${sentenceCase(status.reason)}`.trim();
          if (status.state !== "running") return ended(status);
        }
        await new Promise((go_on) => setTimeout(go_on, POLL_MS));
      }
    }

    /** @param {import("../api.js").ExperimentRun} status */
    function ended(status) {
      bar.hidden = true;
      cancel.hidden = true;
      run.hidden = false;
      run.textContent = "Run it again";
      if (status.state !== "done" || status.file === null) return;
      const recording = /** @type {string} */ (status.file.split("/").at(-1)).replace(/\.parquet$/, "");
      run.classList.remove("primary");
      next.prepend(make("button", { type: "button", class: "primary experiment-diagnose", onclick: () => tried(() => diagnoseIt(recording, drive)) },
        "Diagnose what it recorded"));
    }
    return make("div", {}, bar, words_, next);
  }

  /** @param {DiagnosisJob} job */
  function tail(job) {
    const done = job.state === "done";
    return make("div", { class: "actions" },
      done && make("a", { class: "small", href: diagnosisFile(id, "report.html"), target: "_blank", id: "diagnosis-report" }, "Report"),
      done && make("a", { class: "small", href: diagnosisFile(id, "machine.toml"), download: true }, "Machine file"),
      done && make("a", { class: "small", href: diagnosisFile(id, "result"), target: "_blank" }, "JSON"),
      job.recording_there && make("button", { type: "button", onclick: () => tried(() => diagnoseIt(job.recording, drive, job.request)) }, "Diagnose again"),
      make("button", { type: "button", class: "danger", onclick: () => tried(async () => {
        const sure = await confirmed("Delete this diagnosis?", `${words(job.verdict ?? job.state)}, of ${called}. Its report goes, too; the recording stays.`, "Delete it");
        if (sure) { await removeDiagnosis(id); go("diagnosis", drive); }
      }) }, "Delete …"));
  }

  look();
  return {
    root,
    isSettled: () => isSettled,
    figures: () => figures,
    /** @param {Scales} scales of colours, by the names of figures */
    draw(scales) {
      for (const draw of drawing) draw(scales);
    },
    leave() {
      left = true;
      clearTimeout(timer);
    },
  };
}

/** @param {string[]} head @param {(string | Node)[][]} rows @param {number} [numbers] columns from which on there are numbers */
function table(head, rows, numbers = 1) {
  return make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": `Table: ${head.join(", ")}` }, make("table", {},
    make("thead", {}, make("tr", {}, head.map((text, k) => make("th", { class: k >= numbers && "n", scope: "col" }, text)))),
    make("tbody", {}, rows.map((row) => make("tr", {}, row.map((cell, k) => make("td", { class: k >= numbers && "n" }, cell)))))));
}

/** @param {Diagnosis} said */
function fit({ fit: told, findings: found }) {
  if (told === null) return [];
  const { one_step_rms_V: step, free_run_rms_A: free, explained } = told;
  const volts = (/** @type {number | null} */ value) => quantityText({ value, std: null, unit: "V" }, step.before);
  const amperes = (/** @type {number | null} */ value) => quantityText({ value, std: null, unit: "A" }, free.before);
  const rows = [["voltage, one step ahead", volts(step.before), volts(step.after), volts(step.noise_floor)]];
  if (told.leave_one_out === null) rows.push(["current, free run", amperes(free.before), amperes(free.after), ""]);
  return [make("h3", {}, "Before and after"), table(["residual, rms", "before", "after", "noise floor"], rows),
    make("p", { class: "help" }, `Judged on ${told.held_out ? "stretches that took no part in the fit" : "the rows it was fitted on"}`
      + (found.length > 0 && explained !== null ? `; ${plain(100 * explained, 3)} % of the mismatch's variance is explained.` : "."))];
}

/** @param {Diagnosis} said */
function findings({ findings: found }) {
  if (found.length === 0) return [];
  return [make("h3", {}, "What was left out"), table(["effect", "where it acts", "size ± 95 %", "odds against next"], found.map((one) => [
    make("strong", {}, words(one.effect)), one.where.sentence,
    make("span", {}, ...Object.entries(one.parameters).flatMap(([name, size], k) => [k > 0 ? make("br") : "", `${words(name)} ${quantityText(size)}`])),
    oddsText(one.odds_against_next),
  ]), 2)];
}

/** @param {Diagnosis} said */
function unexplained({ unexplained: left }) {
  if (left === null) return [];
  return [make("h3", {}, "What is unexplained"),
    make("p", {}, `${left.description}: ${quantityText({ value: left.rms_V, std: null, unit: "V" })} rms. ${left.where.sentence}`)];
}

/** @param {Diagnosis} said */
function remarks({ remarks: told }) {
  return told.length === 0 ? [] : [make("h3", {}, "Remarks on the recording"), make("ul", {}, told.map((remark) => make("li", {}, remark)))];
}

/** @param {Diagnosis} said */
function parameters({ machine }) {
  const names = [...new Set([...Object.keys(EACH), ...Object.keys(machine.before), ...Object.keys(machine.after)])]
    .filter((name) => name in machine.before || name in machine.after);
  if (names.length === 0) return [];
  return [make("h3", {}, "Parameters"), table(["", "nominal", "without the effects ± 95 %", "with them ± 95 %"], names.map((name) => {
    const like = machine.nominal[name] ?? machine.after[name]?.value ?? undefined;
    const unit = machine.after[name]?.unit ?? machine.before[name]?.unit ?? "";
    return [name, quantityText({ value: machine.nominal[name] ?? null, std: null, unit }, like),
      quantityText(machine.before[name], like), quantityText(machine.after[name], like)];
  }))];
}
