// What this browser keeps for the pages. Storage may be blocked, missing, full or hold what no page of ours wrote: nothing here throws,
// and what cannot be kept holds until the page is left.

const PROBE = "humanplay.probe";
/** Where a tab keeps the newest episode that tries another again. */
export const TRIED = "humanplay.tried";

/** @param {() => globalThis.Storage} open reading it may throw already @returns {Store} */
export function createStore(open) {
  /** @type {Map<string, string>} */
  const unsaved = new Map();
  /** @template T @param {(storage: globalThis.Storage) => T} work @returns {T | undefined} undefined where the browser refuses */
  function attempt(work) {
    try {
      return work(open());
    } catch {
      return undefined;
    }
  }
  /** @type {Store} */
  const store = {
    getItem: (key) => unsaved.get(key) ?? attempt((storage) => storage.getItem(key)) ?? null,
    setItem(key, text) {
      unsaved.set(key, text);
      attempt((storage) => { storage.setItem(key, text); unsaved.delete(key); });
    },
    removeItem(key) {
      unsaved.delete(key);
      attempt((storage) => storage.removeItem(key));
    },
    read(key) {
      try {
        return JSON.parse(store.getItem(key) ?? "null");
      } catch {
        return null;
      }
    },
    isKept: () => attempt((storage) => {
      storage.setItem(PROBE, "");
      storage.removeItem(PROBE);
      return true;
    }) ?? false,
  };
  return store;
}

/** Of this browser, from one visit to the next. */
export const browserStore = createStore(() => globalThis.localStorage);
/** Of this tab, from one load of a page to the next. */
export const tabStore = createStore(() => globalThis.sessionStorage);

/** A sentence on what a browser forgets that keeps nothing; "" where it keeps what is chosen. */
export const forgets = () => (browserStore.isKept() && tabStore.isKept() ? ""
  : "This browser keeps nothing for this page, so your settings are forgotten when you leave it. To keep them, allow site data for this address.");
