// What the policies think, beside their boards: the legend of the heat map, and what they expect to earn as a strip below the chart.
import { paintChart } from "../../common/chart.js";
import { span, ticks, tickText } from "../../common/chart_scale.js";
import { askExpected } from "../../common/messages.js";
import { by, put } from "../../common/page.js";
import { policyName } from "./names.js";
import { expectedOf, goalText, mostExpected, nextLooks, thoughtOf } from "./thoughts.js";

const ROLES = /** @type {const} */ (["player", "rival"]);

/** Return the boards that policies drive, the player's among them only while two policies are watched.
 * @param {GameState} state @returns {[Role, Mars.Board][]} */
export function policyBoards(state) {
  return ROLES.flatMap((role) => {
    const board = /** @type {Mars.Board | null} */ (state[role]);
    return board && (role === "rival" || state.mode === "watch") ? [/** @type {[Role, Mars.Board]} */ ([role, board])] : [];
  });
}

/** @param {string} name @param {(number | null)[]} values @returns what a policy expects now, in words */
function newestText(name, values) {
  const newest = values.filter((value) => typeof value === "number").pop();
  return newest === undefined || newest === null ? `${policyName(name)} has not said yet what it expects` : `${policyName(name)} expects ${newest.toFixed(1)}`;
}

/** @param {{send: (role: Role, message: object) => boolean,
 *   onChange: () => void}} how onChange: the switch was used */
export function createThinking({ send, onChange }) {
  const wanted = by("show-thoughts", HTMLInputElement);
  wanted.checked = localStorage.getItem("mars.thoughts") === "true";
  const arrange = () => { document.body.dataset.thinking = String(wanted.checked); };
  wanted.addEventListener("change", () => { localStorage.setItem("mars.thoughts", String(wanted.checked)); arrange(); onChange(); });
  arrange();
  const isShown = () => wanted.checked && document.body.dataset.boards !== "1";
  /** @type {Map<Role, Mars.Frame>} the frame that was asked about last */
  const asked = new Map();
  /** @type {Set<string>} policies that have said what they expect: their strip stays between two episodes */
  const outspoken = new Set();

  /** @param {[Role, Mars.Board][]} boards */
  function ask(boards) {
    for (const [role, { frame }] of boards) {
      if (!frame.outcome && asked.get(role) !== frame && send(role, askExpected())) asked.set(role, frame);
    }
  }
  /** @param {[Role, Mars.Board][]} boards */
  function paintNote(boards) {
    const shown = boards.flatMap(([, board]) => { const expected = expectedOf(board); return expected ? [{ board, expected }] : []; });
    by("thoughts-note").hidden = !shown.length;
    if (!shown.length) return;
    put(by("thoughts-who"), shown.map(({ board }) => policyName(board.name)).join(" and "));
    put(by("thoughts-most"), String(Math.max(...shown.map(({ expected }) => mostExpected(expected)))));
    put(by("thoughts-next"), shown.length === 1 ? nextLooks(shown[0].board.frame, shown[0].expected) : "");
    by("thoughts-next-row").hidden = shown.length > 1;
    const goals = goalText(shown.map(({ board }) => board));
    put(by("thoughts-goal"), goals);
    by("thoughts-goal-row").hidden = !goals;
  }
  return {
    /** Return what a board's policy thinks, for its picture: its thought, and what tints the cells.
     * @param {GameState} state @param {Role} role @returns {Pick<Mars.Look, "thought" | "tint">} */
    look(state, role) {
      if (!isShown()) return {};
      const boards = policyBoards(state);
      const expected = expectedOf(boards.find(([each]) => each === role)?.[1] ?? null);
      const most = Math.max(1, ...boards.map(([, board]) => mostExpected(expectedOf(board))));
      return { thought: thoughtOf(/** @type {Mars.Board | null} */ (state[role])), tint: expected && { expected, most } };
    },
    /** Ask for what is missing, and paint the legend and the strip.
     * @param {GameState} state @param {{font: string, inks: Inks, end: number, colours: Record<Role, string>}} look */
    paint(state, { colours, ...look }) {
      const boards = isShown() ? policyBoards(state) : [];
      ask(boards);
      paintNote(boards);
      for (const [, { name, values = [] }] of boards) if (values.some((value) => typeof value === "number")) outspoken.add(name);
      const curves = boards.filter(([, { name }]) => outspoken.has(name))
        .map(([role, { name, values = [] }]) => ({ name: policyName(name), values, colour: colours[role], isDashed: role === "rival" }));
      by("value-strip").hidden = !curves.length;
      put(by("value-line"), valueLine(curves.map(({ name }) => name)));
      const place = by("values");
      place.setAttribute("aria-label", curves.map(({ name, values }) => newestText(name, values)).join("; "));
      paintValues(place, curves, look);
    },
  };
}

/** Return the sentence under which the strip stands; "" while no policy says what it expects.
 * @param {string[]} names of the policies drawn */
export function valueLine(names) {
  return names.length ? `What ${names.map(policyName).join(" and ")} expects to earn from here on, in the points of its training: new ground earns, moves cost` : "";
}

/** Return the values at which the strip has a line and a number: its ends, and nought where that lies well between them.
 * @param {[number, number]} range */
export function stripTicks([low, high]) {
  const found = ticks(low, high);
  const ends = [found[0], found[found.length - 1]];
  const isBetween = (/** @type {number} */ tick) => Math.min(tick - ends[0], ends[1] - tick) > 0.4 * (ends[1] - ends[0]);
  return [...new Set(found.length < 2 ? found : [ends[0], ...found.filter((tick) => tick === 0 && isBetween(tick)), ends[1]])];
}

/** @param {HTMLElement} place @param {Mars.ValueCurve[]} curves
 * @param {{inks: Inks, font: string, end: number}} look end: of the step axis, in moves */
function paintValues(place, curves, { end, ...look }) {
  const range = span(curves.flatMap(({ values }) => values));
  if (!range) return;
  const marks = stripTicks(range);
  const [low, high] = [Math.min(range[0], ...marks), Math.max(range[1], ...marks)];
  paintChart(place, {
    ...look, edges: { left: 44, right: 14, top: 7, bottom: 0 }, base: low < 0 && high > 0 ? 0 : low,
    x: { low: 0, high: end, ticks: [], text: String }, y: { low, high, ticks: marks, text: tickText },
    // A page that skipped a frame has no value for it: the line goes on to the next one.
    lines: curves.map(({ values, colour, isDashed }) => {
      const known = [...values.keys()].filter((step) => typeof values[step] === "number");
      const y = known.map((step) => Number(values[step]));
      return { colour, dash: isDashed ? [6, 4] : [], width: 1.75, dot: 3, x: known, y };
    }),
  });
}
