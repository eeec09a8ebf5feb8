// Keys, touches, focus and visibility as input events, until the server says that it keeps them: in batches of one
// episode, 200 events at most, each with the ids of this load of the page and of its tab. The events that caused a move
// are sent before it, on the same socket, since the server compares the two.
import { events } from "./messages.js";
import { tabStore } from "./storage.js";

/** Events in a batch at most. */
export const BATCH_SIZE = 200;
/** Events kept while there is no connection; the oldest go first. */
export const MAX_WAITING = 5000;

/** Return the events that stand first and belong to one episode.
 * @param {{episode: string, event: RecordedEvent}[]} waiting */
function nextBatch(waiting) {
  const episode = waiting[0]?.episode;
  let count = 0;
  while (count < Math.min(waiting.length, BATCH_SIZE) && waiting[count].episode === episode) count += 1;
  return { episode, batch: waiting.slice(0, count).map(({ event }) => event), count };
}

/** Return an id that nobody else draws; `crypto.randomUUID` is missing where the page came without TLS. */
const drawId = () => Array.from(crypto.getRandomValues(new Uint32Array(4)), (part) => part.toString(16).padStart(8, "0")).join("");

/** Where a tab keeps its id. A tab that is duplicated has its origin's until one of them is closed. */
const TAB = "humanplay.tab";

/** Return what this tab keeps from one load of its page to the next; each load is a tab of its own where the browser
 * blocks storage.
 * @param {string} key of the batches @param {Store} [storage]
 * @returns {{tab: string, stored: Batch[], store: (batches: Batch[]) => void}} */
export function tabStorage(key, storage = tabStore) {
  const before = storage.getItem(TAB) ?? "";
  const tab = /^[0-9a-f]{32}$/.test(before) ? before : drawId();
  storage.setItem(TAB, tab);
  const batches = storage.read(key);
  const stored = Array.isArray(batches) ? batches.filter((batch) => Array.isArray(batch?.events)) : [];
  return { tab, stored, store: (unanswered) => storage.setItem(key, JSON.stringify(unanswered)) };
}

/** Return the episode and the step on screen; episode null where nothing is to be kept.
 * @param {Frame | null | undefined} frame the newest of a board that is driven here
 * @param {Frame | null | undefined} painted the one that was painted last @param {number | null} round_trip_ms */
export function onScreen(frame, painted, round_trip_ms) {
  if (!frame) return { episode: null, step: null, round_trip_ms };
  return { episode: frame.episode, step: painted?.episode === frame.episode ? painted.step : frame.step, round_trip_ms };
}

/**
 *   context   what is on screen; nothing is kept while its episode is null
 *   isHidden  whether the page is
 *   send      true when the message left
 *   tab       id of the tab that the page is loaded in
 *   stored    batches that an earlier load of this tab's page could not see kept; `store` keeps them for the next
 * @param {{context: () => {episode: string | null, step: number | null, round_trip_ms: number | null},
 *   isHidden: () => boolean, now_ms: () => number, send: (message: object) => boolean, tab: string,
 *   stored: Batch[], store: (batches: Batch[]) => void}} how */
export function createTelemetry({ context, isHidden, now_ms, send, tab, stored, store }) {
  const page_load = drawId();
  /** @type {{episode: string, event: RecordedEvent}[]} */
  let waiting = [];
  /** Batches in order; they never change, so that the server knows them again. */
  let batches = stored;
  /** Those of them that were sent over this connection and have no answer.
   * @type {Batch[]} */
  let underWay = [];
  let isDue = false;
  /** The newest time of each kind and code: no two events of a page are the same, however coarse its clock. */
  const newest_ms = new Map();
  /** What was said last of whether the page is hidden, and in which episode.
   * @type {{episode: string | null, isHidden: boolean}} */
  let seen = { episode: null, isHidden: false };

  function seal() {
    const { episode, batch, count } = nextBatch(waiting);
    batches = [...batches, events(episode, batch, { batch: drawId(), page_load, tab })];
    waiting = waiting.slice(count);
  }
  const sendBatch = (/** @type {Batch} */ batch) => send(batch) && underWay.push(batch);
  const count = () => batches.reduce((sum, batch) => sum + batch.events.length, waiting.length);
  /** @param {RecordedEvent["kind"]} kind
   * @param {{code?: string, repeat?: boolean, trusted?: boolean, at_ms?: number}} fields */
  function add(kind, { code, repeat, trusted, at_ms } = {}) {
    const { episode, step, round_trip_ms } = context();
    if (episode === null) return;
    const last_ms = newest_ms.get(`${kind} ${code}`) ?? -Infinity;
    const client_ms = Math.round(Math.max(at_ms ?? now_ms(), last_ms + 0.1) * 10) / 10;
    newest_ms.set(`${kind} ${code}`, client_ms);
    waiting.push({ episode, event: { kind, code: code ?? null, repeat: repeat ?? null, trusted: trusted ?? null, client_ms, step, round_trip_ms } });
    if (count() > MAX_WAITING) waiting = waiting.slice(1);
  }
  const telemetry = {
    /** Note whether the page is visible: with its first frame of an episode, and whenever that changes. */
    look() {
      const { episode } = context();
      if (episode === null || (episode === seen.episode && isHidden() === seen.isHidden)) return;
      seen = { episode, isHidden: isHidden() };
      add(seen.isHidden ? "hidden" : "visible");
    },
    /** @type {typeof add} */
    note(kind, fields) {
      telemetry.look();
      add(kind, fields);
    },
    /** Send the next batch, if there is a connection; while one is under way, the next follows its answer. */
    flush() {
      isDue = underWay.length > 0;
      if (isDue) return;
      if (batches.length === 0 && waiting.length > 0) seal();
      isDue = waiting.length > 0;
      if (batches.length > 0) sendBatch(batches[0]);
    },
    /** Take the server's answer to the batch that was sent first: it is kept, or never will be, or without a reason it
     * is sent again.
     * @param {Socket.EventsAnswer} answer */
    answered({ count, reason }) {
      const batch = underWay.shift();
      if (!batch || (reason === null && count < batch.events.length)) return;
      batches = batches.filter((each) => each !== batch);
      store(batches);
      if (underWay.length === 0 && (isDue || batches.length > 0)) telemetry.flush();
    },
    /** Send again what has no answer: nobody knows whether it arrived over the last connection. */
    reconnected() {
      underWay = [];
      telemetry.flush();
    },
    /** Send everything at once: a move follows. */
    sendAll() {
      while (waiting.length > 0) seal();
      for (const batch of batches) if (!underWay.includes(batch)) sendBatch(batch);
    },
    /** Send everything at once and store what has no answer: the page may never come back. */
    leave() {
      telemetry.sendAll();
      store(batches);
    },
    waiting: count,
  };
  return telemetry;
}
