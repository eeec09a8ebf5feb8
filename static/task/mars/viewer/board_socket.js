// Inside the 3-D view, which is one page for all boards: the name of its frame is "SESSION" or "SESSION?camera=...", and the
// client's socket goes there. Under the address /viewer/SESSION/ the client finds its socket by itself. The frame is marked with
// `data-drawn` while the board that it names is drawn, and hears "viewerlost" when nothing can be drawn any more. A plain script.

(() => {
  document.hasFocus = () => true; // the client connects again only while it has the focus, and the page around it may have it
  const found = /^(.*\/viewer\/)client\//.exec(location.pathname);
  if (!found) return;
  const folder = location.origin.replace(/^http/, "ws") + found[1];
  /** The ground's picture is unpacked within this time, ms, and drawn in the second picture after it has come; the third shows it. */
  const SETTLED_MS = 400;
  const SETTLED_PICTURES = 3;
  /** How long the board before may stay on the stage, ms. */
  const MOST_STALE_MS = 1500;
  /** @type {Worker | null} */
  let socketWorker = null;
  /** How often a scene was begun: what waits for an older one is void. */
  let scenes = 0;

  /** A scene is being built: software_canvas.js keeps the picture before it, and after a while the matrix has the stage. */
  function beginScene() {
    const scene = ++scenes;
    document.documentElement.dataset.scene = "loading";
    setTimeout(() => {
      if (scene === scenes && document.documentElement.dataset.scene === "loading") window.frameElement?.removeAttribute("data-drawn");
    }, MOST_STALE_MS);
  }
  /** The scene has its ground. Mark the frame once a few pictures have been painted since. */
  function endScene() {
    const scene = scenes;
    const since_ms = performance.now();
    let pictures = 0;
    requestAnimationFrame(function wait() {
      pictures += 1;
      if (scene !== scenes) return;
      if (pictures < SETTLED_PICTURES || performance.now() - since_ms < SETTLED_MS) return void requestAnimationFrame(wait);
      document.documentElement.dataset.scene = "drawn";
      window.frameElement?.setAttribute("data-drawn", "true");
    });
  }
  /** @param {MessageEvent<{type?: string, messages?: {type: string}[]}>} event */
  function onMessage({ data }) {
    if (data.type === "connected") beginScene();
    else if (data.type === "message_batch" && data.messages?.some(({ type }) => type === "ImageMessage")) endScene();
  }
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function postMessage(/** @type {{type?: string} | null} */ message, /** @type {unknown[]} */ ...rest) {
    if (message?.type !== "set_server" && message?.type !== "retry") return void Reflect.apply(post, this, [message, ...rest]);
    if (socketWorker !== this) this.addEventListener("message", onMessage);
    socketWorker = this;
    Reflect.apply(post, this, [{ type: "set_server", server: folder + window.name }]);
  };
  // The page around it calls this after it has changed the frame's name. The client hears that its socket has closed, and connects
  // again. Were the socket only exchanged, it would not tell the new one where it looks from, and the server waits for that.
  const showBoard = () => socketWorker?.dispatchEvent(new MessageEvent("message", { data: { type: "closed" } }));
  Object.defineProperty(window, "showBoard", { value: showBoard });

  function lose() {
    scenes += 1;
    window.frameElement?.removeAttribute("data-drawn");
    window.frameElement?.dispatchEvent(new Event("viewerlost"));
  }
  addEventListener("webglcontextlost", lose, true);
  addEventListener("DOMContentLoaded", () => {
    const root = document.querySelector("#root"); // of viser's page: React empties it when the client breaks
    if (root) new MutationObserver(() => { if (!root.childElementCount) lose(); }).observe(root, { childList: true });
  });
})();
