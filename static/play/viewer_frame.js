// @ts-check
// The frame of a board's 3-D view: which board it shows, and what is done when nothing can be drawn in it. It is marked with
// `data-drawn` only while its board is drawn (board_socket.js); without that mark the board's matrix has the stage.

/** How long to wait before the client of a frame is loaded again, ms; after the last the matrix keeps the stage. */
const RELOADS_MS = [300, 3000, 15_000];
/** A client that has drawn for so long begins to count anew, ms. */
const HEALTHY_MS = 60_000;

/** Return the address of the 3-D client, one for all boards; where the processor draws it, with coarser pixels and on a
 * canvas of its own (software_canvas.js), so that keys stay quick.
 * @param {boolean} isSoftware */
export function clientUrl(isSoftware) {
  return `viewer/client/${isSoftware ? "?fixedDpr=0.75&software-canvas" : ""}`;
}

/** Show a session in a frame: its name says which (board_socket.js), and a client that is there already only changes
 * its socket.
 * @param {HTMLIFrameElement} viewer @param {string | null} name session and wishes; null: nothing
 * @param {boolean} isSoftware */
export function showBoard(viewer, name, isSoftware) {
  const inside = insideOf(viewer);
  const before = viewer.dataset.name ?? "";
  viewer.dataset.name = name ?? "";
  if (inside) inside.name = name ?? "";
  if (before.split("?")[0] !== name?.split("?")[0]) viewer.removeAttribute("data-drawn"); // what is drawn is another board's
  if (name === null) viewer.removeAttribute("src");
  else if (!viewer.getAttribute("src")) viewer.src = clientUrl(isSoftware);
  else inside?.showBoard?.();
}

/** Return what the page needs of the frame's window, or null where the browser keeps it closed, as it does its own
 * error page.
 * @param {HTMLIFrameElement} viewer @returns {{name: string, showBoard?: () => void} | null} */
function insideOf(viewer) {
  try {
    const inside = /** @type {{name: string, showBoard?: () => void} | null} */ (/** @type {unknown} */ (viewer.contentWindow));
    return inside && typeof inside.name === "string" ? inside : null;
  } catch {
    return null;
  }
}

/** Load the client again where it was not served, broke, or lost what it draws with.
 * @param {HTMLIFrameElement} viewer @param {boolean} isSoftware */
export function reloadWhenLost(viewer, isSoftware) {
  let reloads = 0;
  let lost_ms = -Infinity;
  let isDue = false;
  function reload() {
    isDue = false;
    if (!viewer.getAttribute("src")) return;
    viewer.contentWindow?.location.replace(new URL(clientUrl(isSoftware), viewer.ownerDocument.baseURI));
  }
  function onLost() {
    viewer.removeAttribute("data-drawn");
    if (isDue) return;
    const now_ms = performance.now();
    if (now_ms - lost_ms > HEALTHY_MS) reloads = 0;
    lost_ms = now_ms;
    if (reloads >= RELOADS_MS.length) return;
    isDue = true;
    setTimeout(reload, RELOADS_MS[reloads]);
    reloads += 1;
  }
  viewer.addEventListener("viewerlost", onLost);
  viewer.addEventListener("load", () => {
    const inside = insideOf(viewer);
    if (!viewer.getAttribute("src")) return;
    if (!inside?.showBoard) onLost();
    else if (inside.name !== viewer.dataset.name) { // it has changed while the frame was closed
      inside.name = viewer.dataset.name ?? "";
      inside.showBoard();
    }
  });
}
