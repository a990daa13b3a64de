/**
 * The room of recordings: a list with search and filters, and the one that is chosen.
 *
 * @typedef {import("../api.js").Recording} Recording
 */

import { listRecordings } from "../api.js";
import { make } from "../dom.js";
import { element } from "../fields.js";
import { bytes, clock, counted, duration } from "../format.js";
import { address, go } from "../router.js";
import { bringFile } from "./bring_file.js";
import { recordingView } from "./recording_view.js";

const REFRESH_MS = 3000;
const KINDS = [["", "all kinds"], ["stream", "streams"], ["capture", "captures"], ["experiment", "experiments"], ["file", "files"]];

/** @returns {import("../main.js").RoomPart} */
export function recordingsRoom() {
  const search = /** @type {HTMLInputElement} */ (make("input", { id: "recordings-search", class: "text", type: "search",
    placeholder: "search", "aria-label": "Search recordings", maxlength: 200 }));
  const kind = /** @type {HTMLSelectElement} */ (make("select", { id: "recordings-kind", "aria-label": "Kind" },
    KINDS.map(([value, words]) => make("option", { value }, words))));
  const all = /** @type {HTMLInputElement} */ (make("input", { id: "recordings-all", type: "checkbox" }));
  const list = make("ul", { id: "recordings-list", class: "list" });
  const count = make("p", { id: "recordings-count", class: "section-note", role: "status" });
  const more = make("button", { type: "button", id: "recordings-more", hidden: true }, "Older ones");
  const view = recordingView();

  element("room-recordings").append(
    make("h1", { class: "visually-hidden" }, "Recordings"),
    make("div", { class: "split" },
      make("section", { class: "card side", "aria-label": "List of recordings" },
        make("div", { class: "filters" }, search, kind,
          make("label", { class: "switch" }, all, make("span", {}, "of all drives"))),
        bringFile((one) => {
          all.checked = true; // a file is of no drive
          again();
          go("recordings", drive, one.id);
        }),
        count, list, more),
      view.root));

  let drive = "";
  let timer = 0;
  /** @type {string | null} */
  let chosen = null;
  /** What has been asked for of older pages. @type {Recording[]} */
  let older = [];
  /** @type {string | null} */
  let next = null;
  let asked = 0;

  async function refresh() {
    const mine = ++asked;
    try {
      const page = await listRecordings({ drive: all.checked ? "" : drive, kind: kind.value, text: search.value.trim() });
      if (mine !== asked) return;
      if (older.length === 0) next = page.next;
      show([...page.recordings, ...older.filter((one) => page.recordings.every(({ id }) => id !== one.id))], page.total);
    } catch (error) {
      if (mine === asked) count.textContent = /** @type {Error} */ (error).message;
    }
  }

  /** @param {Recording[]} recordings @param {number} total */
  function show(recordings, total) {
    const filtered = search.value.trim() !== "" || kind.value !== "";
    const words = total === 0 ? (filtered ? "None that fits the search." : "None yet. Live records the stream, and captures every control period.")
      : total === 1 ? "One recording." : `${total} recordings, the newest first.`;
    if (count.textContent !== words) count.textContent = words;
    more.hidden = next === null;
    const key = JSON.stringify([recordings, chosen]);
    if (list.dataset.key === key) return;
    list.dataset.key = key;
    list.replaceChildren(...recordings.map((one) => row(one, chosen, drive)));
    view.offer(recordings);
  }

  function again() {
    older = [];
    next = null;
    refresh();
  }

  search.addEventListener("input", again);
  kind.addEventListener("change", again);
  all.addEventListener("change", again);
  more.addEventListener("click", async () => {
    if (next === null) return;
    const page = await listRecordings({ drive: all.checked ? "" : drive, kind: kind.value, text: search.value.trim(), before: next });
    older.push(...page.recordings);
    next = page.next;
    refresh();
  });

  return {
    enter(name, id) {
      drive = name;
      chosen = id;
      list.dataset.key = "";
      clearInterval(timer);
      timer = setInterval(() => { if (!document.hidden) { refresh(); view.refresh(); } }, REFRESH_MS);
      view.show(id, drive);
      refresh();
    },
    leave() {
      clearInterval(timer);
    },
  };
}

/** @param {Recording} one @param {string | null} chosen @param {string} drive */
function row(one, chosen, drive) {
  const facts = [clock(one.begun), one.seconds === null ? "" : duration(one.seconds), bytes(one.bytes)];
  const state = one.state === "done" ? (one.whole ? "" : one.rows > 0 ? "cut" : "damaged") : one.state;
  return make("li", {}, make("a", { href: address("recordings", drive, one.id), "aria-current": one.id === chosen && "true" },
    make("span", { class: "row-head" }, make("strong", {}, one.title || one.id),
      state !== "" && make("span", { class: `chip ${state === "recording" ? "bad" : "warn"}` }, state)),
    make("span", { class: "row-facts" }, `${one.kind}${one.drive === "" || one.drive === drive ? "" : ` of ${one.drive}`} · ${facts.filter((fact) => fact !== "").join(" · ")}`
      + (one.marks.length > 0 ? ` · ${counted(one.marks.length, "mark")}` : "")),
    !one.whole && one.reason !== "" && make("span", { class: "row-facts" }, `${state}: ${one.reason}`)));
}
