/**
 * Which room is shown, of which drive, and what of it: in the address after `#`, as `#recordings/spindle/ID`, so that
 * a reload, a link and the browser's Back lead there again. Knows nothing of what is in the rooms.
 *
 * @typedef {"live" | "recordings" | "diagnosis" | "drive"} Room
 * @typedef {{room: Room, drive: string | null, id: string | null}} Place
 */

/** @type {Room[]} */
export const ROOMS = ["live", "recordings", "diagnosis", "drive"];

/** @returns {Place} */
export function place() {
  const [room, drive, id] = location.hash.slice(1).split("/").map(decoded);
  if (ROOMS.includes(/** @type {Room} */ (room))) {
    return { room: /** @type {Room} */ (room), drive: drive || null, id: id || null };
  }
  return { room: "live", drive: room || null, id: null };
}

/** @param {string} text */
function decoded(text) {
  try { return decodeURIComponent(text); } catch { return text; }
}

/**
 * @param {Room} room
 * @param {string | null} [drive]
 * @param {string | null} [id]
 */
export function address(room, drive = place().drive, id = null) {
  const parts = [room, drive, drive === null ? null : id].filter((part) => part !== null);
  return `#${parts.map((part) => encodeURIComponent(String(part))).join("/")}`;
}

/**
 * Goes there, as a link does.
 * @param {Room} room
 * @param {string | null} [drive]
 * @param {string | null} [id]
 */
export function go(room, drive = place().drive, id = null) {
  location.hash = address(room, drive, id);
}

/**
 * The same place under its full name: nothing to go back to.
 * @param {Place} known
 */
export function settle({ room, drive, id }) {
  history.replaceState(null, "", address(room, drive, id));
}

/** @param {(place: Place) => void} listener */
export function onPlace(listener) {
  window.addEventListener("hashchange", () => listener(place()));
}
