// 3-D or matrix: which of the two fills a board, how the 3-D view is drawn, and the frame in which it stands.
import { ROOT } from "../../common/api.js";
import { by, create } from "../../common/page.js";
import { browserStore } from "../../common/storage.js";
import { LARGE_SIDE } from "./zoom.js";

/** Return whether this browser can draw the 3-D view, and whether its processor has to do it. */
function probeWebGL() {
  try {
    const canvas = document.createElement("canvas");
    const context = /** @type {WebGLRenderingContext | null} */ (canvas.getContext("webgl2") ?? canvas.getContext("webgl"));
    if (!context) return { can3d: false, isSoftware: false };
    const info = context.getExtension("WEBGL_debug_renderer_info");
    const renderer = String(context.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER));
    context.getExtension("WEBGL_lose_context")?.loseContext();
    return { can3d: true, isSoftware: /swiftshader|llvmpipe|softpipe|software|basic render/i.test(renderer) };
  } catch {
    return { can3d: false, isSoftware: false };
  }
}

/** Return whether shadows, haze and movement are drawn: as chosen ("on", "off"), else where a GPU draws and nobody asks
 * for calm.
 * @param {string | null} choice what is kept in mars.effects @param {boolean} isSoftware
 * @param {boolean} isCalm the system asks for reduced motion */
export const hasEffects = (choice, isSoftware, isCalm) => choice === "on" || (choice !== "off" && !isSoftware && !isCalm);

/** @param {{panels: Play.Panel[], onChange: () => void}} how */
export function createViews({ panels, onChange }) {
  const { can3d, isSoftware } = probeWebGL();
  let view = can3d && browserStore.getItem("humanplay.view") !== "matrix" ? "3d" : "matrix";
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  /** @param {string} session */
  const nameOf = (session) => {
    const chosen = browserStore.getItem("humanplay.camera");
    const effects = hasEffects(browserStore.getItem("humanplay.effects"), isSoftware, calm.matches) ? "on" : "off";
    const wishes = { ...(chosen ? { camera: chosen } : {}), effects };
    if (document.documentElement.dataset.theme === "light") Object.assign(wishes, { theme: "light" });
    return `${encodeURIComponent(session)}?${new URLSearchParams(wishes)}`;
  };
  const effectsChoice = by("effects", HTMLSelectElement);
  effectsChoice.value = browserStore.getItem("humanplay.effects") ?? "auto";
  effectsChoice.addEventListener("change", () => { browserStore.setItem("humanplay.effects", effectsChoice.value); onChange(); });
  const camera = panels[0].part.camera; // for both boards
  const repaintCamera = startCameraControl(camera, onChange);
  for (const { viewer } of panels) reloadWhenLost(viewer, isSoftware);
  const button = panels[0].part.view;
  let isMatrixOnly = false;
  function show() {
    document.body.dataset.view = isMatrixOnly ? "matrix" : view;
    button.hidden = !can3d || isMatrixOnly;
    camera.hidden = !can3d || isMatrixOnly || view === "matrix";
    button.textContent = view === "3d" ? "Matrix" : "3-D";
    button.setAttribute("aria-label", view === "3d" ? "Show the state matrix large" : "Show the 3-D view");
  }
  button.addEventListener("click", () => {
    view = view === "3d" ? "matrix" : "3d";
    browserStore.setItem("humanplay.view", view);
    show();
    onChange();
  });
  show();
  return {
    /** Leave the 3-D view out, which is for a player's own boards, or offer it again.
     * @param {boolean} isWanted */
    showMatrixOnly(isWanted) {
      if (isMatrixOnly === isWanted) return;
      isMatrixOnly = isWanted;
      show();
    },
    /** Show a session in 3-D as it is wished for now; nothing is loaded while the matrix is on stage.
     * @param {Play.Panel} panel @param {string | null} session */
    load({ viewer }, session) {
      const name = session && nameOf(session);
      if (view !== "3d" || viewer.dataset.name === (name ?? "")) return;
      showBoard(viewer, name, isSoftware);
    },
    /** Put the small map over a corner of the stage where it covers neither the rover nor the route.
     * @param {Play.Panel} panel @param {Board | null} board */
    placeMap({ root }, board) {
      if (!board) return;
      const { frame, trail } = /** @type {Mars.Board} */ (board);
      const isFollowed = cameraOf(browserStore.getItem("humanplay.camera"), Math.max(frame.rows, frame.cols)) === "follow";
      root.dataset.corner = isFollowed ? CORNERS[0] : freeCorner(frame, trail);
    },
    /** @param {Frame | null | undefined} frame */
    paintCamera(frame) {
      const { rows = 0, cols = 0 } = /** @type {Mars.Frame | undefined} */ (frame ?? undefined) ?? {};
      repaintCamera(Math.max(rows, cols));
    },
  };
}

/** Where the small map may lie, the first free one is taken; none where the route has been in all of them. */
const CORNERS = Object.freeze(["north-east", "south-east", "south-west", "north-west"]);
/** Share of a side of the board that the small map covers at most, as the 3-D view of all of it is drawn. */
const COVERED = 0.36;

/** @param {{rows: number, cols: number, position: Cell}} board @param {Cell[]} trail @returns the corner without rover and route */
export function freeCorner({ rows, cols, position }, trail) {
  const cells = [...trail, position];
  return CORNERS.find((corner) => !cells.some(([row, col]) =>
    (corner.startsWith("north") ? row + 1 : rows - row) <= Math.ceil(COVERED * rows)
    && (corner.endsWith("west") ? col + 1 : cols - col) <= Math.ceil(COVERED * cols))) ?? "none";
}

/** Return which camera shows a board: the one chosen, else by its size.
 * @param {string | null} choice what is kept in mars.camera @param {number} side the longer one, cells */
export const cameraOf = (choice, side) => (choice === "map" || choice === "follow" ? choice : side > LARGE_SIDE ? "follow" : "map");

/** Fill the group with its buttons; return a function that paints them for a board's longer side.
 * @param {HTMLElement} group @param {() => void} onChange */
function startCameraControl(group, onChange) {
  let side = 0;
  const button = create("button", [], { type: "button", class: "quiet view", "data-testid": "camera" });
  button.addEventListener("click", () => {
    browserStore.setItem("humanplay.camera", cameraOf(browserStore.getItem("humanplay.camera"), side) === "map" ? "follow" : "map");
    onChange();
  });
  group.append(button);
  return (/** @type {number} */ longer) => {
    side = longer;
    const isMap = cameraOf(browserStore.getItem("humanplay.camera"), side) === "map";
    button.textContent = isMap ? "Follow" : "Whole map";
    button.title = isMap ? "Follow the rover in 3-D. Drag the picture to turn it" : "Show the whole map in 3-D. Drag the picture to turn it";
  };
}

// The frame of a board's 3-D view is marked with `data-drawn` only while its board is drawn (viewer/board_socket.js); without that mark
// the board's matrix has the stage.

/** How long to wait before the client of a frame is loaded again, ms; after the last the matrix keeps the stage. */
const RELOADS_MS = [300, 3000, 15_000];
/** A client that has drawn for so long begins to count anew, ms. */
const HEALTHY_MS = 60_000;

/** Return the address of the 3-D client, one for all boards; where the processor draws it, with coarser pixels and on a
 * canvas of its own (software_canvas.js), so that keys stay quick.
 * @param {boolean} isSoftware */
export const clientUrl = (isSoftware) => `${ROOT}viewer/client/${isSoftware ? "?fixedDpr=0.75&software-canvas" : ""}`;

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
