// @ts-check
// 3-D or matrix: which of the two fills a board, and what the canvases measure.

/** True when this browser can draw the 3-D view. @param {Document} page */
export function hasWebGL(page) {
  try {
    const canvas = page.createElement("canvas");
    const context = /** @type {WebGLRenderingContext | null} */ (canvas.getContext("webgl2") ?? canvas.getContext("webgl"));
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return context !== null;
  } catch {
    return false;
  }
}

/**
 * @param {{page: Document, panels: import("./panels.js").Panel[], storage: Storage, onChange: () => void}} how
 */
export function createViews({ page, panels, storage, onChange }) {
  const can3d = hasWebGL(page);
  let view = can3d && storage.getItem("mars.view") !== "matrix" ? "3d" : "matrix";
  /** @type {Map<HTMLElement, {width_px: number, height_px: number}>} */
  const sizes = new Map();
  const observer = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) sizes.set(/** @type {HTMLElement} */ (target), { width_px: contentRect.width, height_px: contentRect.height });
    onChange();
  });
  const button = panels[0].part.view;
  function show() {
    page.body.dataset.view = view;
    button.hidden = !can3d;
    button.textContent = view === "3d" ? "Matrix" : "3-D";
    button.setAttribute("aria-label", view === "3d" ? "Show the state matrix large" : "Show the 3-D view");
  }
  button.addEventListener("click", () => {
    view = view === "3d" ? "matrix" : "3d";
    storage.setItem("mars.view", view);
    show();
    onChange();
  });
  show();
  return {
    can3d,
    /** @param {HTMLElement} element */
    watch: (element) => observer.observe(element),
    /** @param {HTMLElement} element */
    size: (element) => sizes.get(element) ?? { width_px: element.clientWidth, height_px: element.clientHeight },
    /** Shows a session in 3-D, once; nothing is loaded while the matrix is on stage. @param {import("./panels.js").Panel} panel @param {string | null} session */
    load({ viewer }, session) {
      if (view !== "3d" || viewer.dataset.session === (session ?? "")) return;
      viewer.dataset.session = session ?? "";
      if (session) viewer.src = `viewer/${encodeURIComponent(session)}/`;
      else viewer.removeAttribute("src");
    },
  };
}
