/**
 * What a parameter set would change, as a table, with all that forbids it. Pure: a plan in, elements out.
 *
 * @typedef {import("../api.js").Plan} Plan
 * @typedef {import("../api.js").PlannedChange} PlannedChange
 */

import { make } from "../dom.js";
import { counted, exact } from "../format.js";
import { unitShown } from "./quantity.js";

const HEAD = ["parameter", "now", "then", "unit", "bits now", "bits then", "rounded by"];
/** Digits by which two values of 32 bits can be told apart. */
export const DIGITS = 7;
const ENTRY = /^(\w+_table)_[0-9]+$/;

/** The table that a parameter is an entry of; null for all others. @param {string} name */
export function tableOf(name) {
  return ENTRY.exec(name)?.[1] ?? null;
}

/** What it would do, in a sentence. @param {Plan} plan */
export function planWords({ changes, same, problems }) {
  return problems.length > 0 ? "It may not be flashed." : changes.length === 0 ? `Nothing would change: ${counted(same, "value is", "values are")} as the drive has them.`
    : `${counted(changes.length, "value changes", "values change")}, ${same} stay.`;
}

/** @param {Plan} plan */
export function planElements(plan) {
  const scalars = plan.changes.filter(({ signal }) => tableOf(signal) === null);
  const tables = [...new Set(plan.changes.map(({ signal }) => tableOf(signal)).filter((name) => name !== null))];
  return [
    make("p", { class: "plan-words" }, planWords(plan)),
    ...list("What forbids it", "bad", plan.problems), ...list("What is doubtful", "warn", plan.doubts),
    ...list("Remarks", "", plan.remarks),
    ...(scalars.length === 0 ? [] : [changesTable("Values that would change", scalars)]),
    ...tables.map((table) => {
      const changes = plan.changes.filter(({ signal }) => tableOf(signal) === table);
      return make("details", { class: "fold" }, make("summary", {}, `${table}: ${counted(changes.length, "entry changes", "entries change")}`),
        changesTable(`Entries of ${table} that would change`, changes));
    }),
  ];
}

/** @param {string} label @param {PlannedChange[]} changes */
function changesTable(label, changes) {
  return make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": label }, make("table", { class: "plan" },
    make("thead", {}, make("tr", {}, HEAD.map((text, k) => make("th", { class: ![0, 3].includes(k) && "n", scope: "col" }, text)))),
    make("tbody", {}, changes.map((change) => make("tr", {}, cells(change).map((cell, k) => make("td", { class: ![0, 3].includes(k) && "n", "data-head": HEAD[k] }, cell)))))));
}

/** @param {PlannedChange} change */
function cells({ signal, unit, old, new: then, bits_old, bits_new, rounding }) {
  return [make("code", {}, signal), exact(old, DIGITS), make("strong", {}, exact(then, DIGITS)), unitShown(unit),
    make("code", {}, bits_old), make("code", {}, bits_new), rounding === 0 ? "" : exact(rounding, 2)];
}

/** @param {string} title @param {string} mood @param {string[]} lines */
function list(title, mood, lines) {
  return lines.length === 0 ? [] : [make("div", { class: `told ${mood}` }, make("h3", {}, `${title}:`), make("ul", {}, lines.map((line) => make("li", {}, line))))];
}
