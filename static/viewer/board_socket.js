// @ts-check
// Inside the 3-D view, which is one page for all boards: the name of its frame is "SESSION" or "SESSION?camera=...", and the
// client's socket goes there. Under the address /viewer/SESSION/ the client finds its socket by itself. A plain script.

(() => {
  document.hasFocus = () => true; // the client connects again only while it has the focus, and the page around it may have it
  const found = /^(.*\/viewer\/)client\//.exec(location.pathname);
  if (!found) return;
  const folder = location.origin.replace(/^http/, "ws") + found[1];
  /** The time in which the ground's picture is unpacked. */
  const SETTLED_MS = 400;
  /** @type {Worker | null} */
  let socketWorker = null;
  /**
   * Mark the frame once a board is drawn in it: its ground has come, and a few pictures have been painted since.
   * @param {MessageEvent<{type?: string, messages?: {type: string}[]}>} event
   */
  function onMessage({ currentTarget, data }) {
    if (data.type !== "message_batch" || !data.messages?.some(({ type }) => type === "ImageMessage")) return;
    currentTarget?.removeEventListener("message", /** @type {EventListener} */ (/** @type {unknown} */ (onMessage)));
    const since_ms = performance.now();
    let pictures = 0;
    requestAnimationFrame(function wait() {
      pictures += 1;
      if (pictures < 5 || performance.now() - since_ms < SETTLED_MS) requestAnimationFrame(wait);
      else window.frameElement?.setAttribute("data-drawn", "true");
    });
  }
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function postMessage(/** @type {{type?: string} | null} */ message, /** @type {unknown[]} */ ...rest) {
    if (message?.type !== "set_server" && message?.type !== "retry") return void Reflect.apply(post, this, [message, ...rest]);
    if (socketWorker !== this) this.addEventListener("message", onMessage);
    socketWorker = this;
    Reflect.apply(post, this, [{ type: "set_server", server: folder + window.name }]);
  };
  // The page around it calls this after it has changed the frame's name.
  Object.defineProperty(window, "showBoard", { value: () => socketWorker?.postMessage({ type: "retry" }) });
})();
