// The choice of colours: automatic (as the system asks), dark or light. A plain script in the head, before the style sheets, so that
// no page is ever painted in the wrong colours. `theme` is dispatched on the window when the colours have changed.
{
  const KEY = "humanplay.theme";
  /** @type {Record<string, {says: string, path: string}>} */
  const LOOKS = {
    auto: { says: "as your system", path: "M10 3a7 7 0 1 0 0 14z M10 3a7 7 0 0 1 0 14" },
    dark: { says: "dark", path: "M16 12.2A6.8 6.8 0 0 1 7.8 4a6.6 6.6 0 1 0 8.2 8.2z" },
    light: { says: "light", path: "M10 6.4a3.6 3.6 0 1 0 0 7.2 3.6 3.6 0 0 0 0-7.2zM10 2v1.6M10 16.4V18M2 10h1.6M16.4 10H18M4.3 4.3l1.2 1.2M14.5 14.5l1.2 1.2M15.7 4.3l-1.2 1.2M5.5 14.5l-1.2 1.2" },
  };
  const root = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: light)");

  function dress() {
    root.dataset.theme = choice !== "auto" ? choice : system.matches ? "light" : "dark";
  }

  /** Return what is kept in this browser; "auto" when nothing is, or when it keeps nothing. */
  function kept() {
    try {
      const value = localStorage.getItem(KEY) ?? "auto";
      return Object.hasOwn(LOOKS, value) ? value : "auto";
    } catch {
      return "auto";
    }
  }
  let choice = kept();

  /** @param {string} wanted */
  function show(wanted) {
    choice = wanted;
    dress();
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("button.theme"))) paintButton(button);
    dispatchEvent(new Event("theme"));
  }

  /** @param {HTMLButtonElement} button */
  function paintButton(button) {
    const { says, path } = LOOKS[choice];
    const pieces = path.split(" M").map((piece, index) => `<path d="${index ? "M" : ""}${piece}"${choice === "auto" && !index ? ' class="solid"' : ""}/>`);
    button.innerHTML = `<svg viewBox="0 0 20 20" aria-hidden="true">${pieces.join("")}</svg>`;
    button.title = `Colours: ${says}`;
    button.setAttribute("aria-label", `Colours: ${says}. Change`);
    button.hidden = false;
  }

  /** Go on to the next choice, and keep it: from automatic to the other colours first, so that the first press shows something. */
  function next() {
    const order = system.matches ? ["auto", "dark", "light"] : ["auto", "light", "dark"];
    const wanted = order[(order.indexOf(choice) + 1) % order.length];
    try {
      localStorage.setItem(KEY, wanted);
    } catch {
      // the choice holds until the page is left
    }
    show(wanted);
  }

  dress();
  system.addEventListener("change", () => show(choice));
  addEventListener("storage", ({ key }) => { if (key === KEY || key === null) show(kept()); });
  document.addEventListener("DOMContentLoaded", () => {
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("button.theme"))) {
      paintButton(button);
      button.addEventListener("click", next);
    }
  });
}
