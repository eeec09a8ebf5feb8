// Inside the 3-D view, where the processor draws it (`?software-canvas` in its address). To show such a canvas a browser waits for
// each picture on the page's own thread, and keys wait with it. So that canvas stays hidden. One picture is drawn at a time, read back
// without waiting, and copied to an overlay once it is complete. A plain script: it has to run before the client's own.

(() => {
  if (!new URLSearchParams(location.search).has("software-canvas")) return;

  /** How often a picture under way is asked for, and how long the processor rests after it: as long as it took, within
   * these, ms; the least while a scene is being built, which is not shown yet. */
  const POLL_MS = 8;
  const LEAST_REST_MS = 30;
  const MOST_REST_MS = 250;

  const nextFrame = window.requestAnimationFrame.bind(window);
  const open = HTMLCanvasElement.prototype.getContext;
  /** @type {Map<number, FrameRequestCallback>} what waits for the next frame */
  let waiting = new Map();
  /** @type {typeof waiting} what runs in this one */
  let running = new Map();
  let count = 0;
  let isBusy = false;
  let isScheduled = false;
  /** @type {ReturnType<typeof createOverlay> | null} */
  let overlay = null;

  function schedule() {
    if (isScheduled || isBusy || waiting.size === 0) return;
    isScheduled = true;
    nextFrame(runFrame);
  }
  /** @param {number} now_ms */
  function runFrame(now_ms) {
    isScheduled = false;
    isBusy = true; // what is asked for from here on waits until this picture is complete
    [running, waiting] = [waiting, new Map()];
    for (const callback of running.values()) {
      try {
        callback(now_ms);
      } catch (error) {
        reportError(error);
      }
    }
    const isBuilding = document.documentElement.dataset.scene === "loading";
    if (!overlay?.fetch((took_ms) => setTimeout(resume, isBuilding ? LEAST_REST_MS : Math.min(MOST_REST_MS, Math.max(LEAST_REST_MS, took_ms))))) resume();
  }
  function resume() {
    isBusy = false;
    schedule();
  }
  window.requestAnimationFrame = (callback) => {
    count += 1;
    waiting.set(count, callback);
    schedule();
    return count;
  };
  window.cancelAnimationFrame = (number) => { if (!waiting.delete(number)) running.delete(number); };

  HTMLCanvasElement.prototype.getContext = /** @type {typeof open} */ (function getContext(
    /** @this {HTMLCanvasElement} */ /** @type {string} */ kind, /** @type {WebGLContextAttributes | undefined} */ options) {
    const isBoard = kind === "webgl2" && this.isConnected && !overlay;
    const context = open.call(this, kind, isBoard ? { ...options, preserveDrawingBuffer: false } : options);
    if (isBoard && context) overlay = createOverlay(this, /** @type {WebGL2RenderingContext} */ (context));
    return context;
  });

  /** @param {HTMLCanvasElement} canvas @param {WebGL2RenderingContext} gl */
  function createOverlay(canvas, gl) {
    const shown = document.createElement("canvas");
    shown.style.cssText = "position:absolute;inset:0;width:100%;height:100%;transform:scaleY(-1);pointer-events:none;background:#0e0b0d"; // rows come from the bottom up
    canvas.style.visibility = "hidden";
    canvas.after(shown);
    const target = /** @type {CanvasRenderingContext2D} */ (open.call(shown, "2d"));
    let picture = new ImageData(1, 1);
    let buffer = gl.createBuffer();
    let isDrawn = false;
    let isHeld = false;
    let losses = 0;
    const clear = gl.clear.bind(gl);
    gl.clear = (mask) => {
      isDrawn = true;
      clear(mask);
    };
    canvas.addEventListener("webglcontextlost", () => { losses += 1; });
    canvas.addEventListener("webglcontextrestored", () => {
      buffer = gl.createBuffer();
      picture = new ImageData(1, 1);
    });

    function copyPicture() {
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, picture.data);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
      show();
    }
    /** Show the picture that was read, once its scene is complete (board_socket.js): until then the one before it stays. */
    function show() {
      isHeld = document.documentElement.dataset.scene === "loading";
      if (isHeld) return;
      if (shown.width !== picture.width || shown.height !== picture.height) [shown.width, shown.height] = [picture.width, picture.height];
      target.putImageData(picture, 0, 0);
    }
    return {
      /** Ask for what was drawn since the last time; return false when nothing was. Not while a picture is under way: a
       * buffer that changes its size then costs the browser its whole context.
       * @param {(took_ms: number) => void} onDone */
      fetch(onDone) {
        if (isHeld) show();
        if (!isDrawn || gl.isContextLost()) return false;
        isDrawn = false;
        const began_ms = performance.now();
        const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
        gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
        if (picture.width !== width || picture.height !== height) {
          picture = new ImageData(width, height);
          gl.bufferData(gl.PIXEL_PACK_BUFFER, picture.data.byteLength, gl.STREAM_READ);
        }
        const bound = gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
        gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
        gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, 0);
        gl.bindFramebuffer(gl.READ_FRAMEBUFFER, bound);
        gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
        const fence = /** @type {WebGLSync} */ (gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0));
        gl.flush();
        const before = losses;
        function poll() {
          const isLost = losses !== before || gl.isContextLost();
          if (!isLost && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) return void setTimeout(poll, POLL_MS);
          if (!isLost) {
            gl.deleteSync(fence);
            copyPicture();
          }
          onDone(performance.now() - began_ms);
        }
        setTimeout(poll, POLL_MS);
        return true;
      },
    };
  }
})();
