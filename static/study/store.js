// The state of the study's page and what changes it: events, and steps through the stages. One request at a time, each answered by
// the participant's stage and board; other tabs are notified.
import { ApiError } from "../common/api.js";
import { tabStore } from "../common/storage.js";
import { t } from "../common/texts.js";
import { bareAddress, createStudyApi, invitationIn, outsideIds, studyName, ticketIn } from "./api.js";
import { apply, initialState } from "./state.js";

export const name = studyName(location.pathname);
export const study = createStudyApi(name);
/** To other tabs of this study; null where a browser has no such thing. */
export const channel = "BroadcastChannel" in window ? new BroadcastChannel(`humanplay.study.${name}`) : null;
/** Of the newest state. */
export let state = initialState();
export const frame = () => state.game.player?.frame;
export const stage = () => state.participant?.stage;
/** @type {(before: Study.State) => void} */
let changed = () => {};
/** @param {typeof changed} work after each change, with the state before */
export const whenChanged = (work) => { changed = work; };

/** Apply an event: the only place where the state changes.
 * @param {Study.Event} event */
export function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state !== before) changed(before);
}

/** @type {Promise<unknown>} */
let queue = Promise.resolve();
/** Whether a request waits for its answer: another press of its button would be one too many. */
export let isBusy = false;

/** @param {() => Promise<void>} work @returns {Promise<void>} */
function inTurn(work) {
  const done = queue.then(work);
  queue = done.catch(() => {});
  return /** @type {Promise<void>} */ (done);
}
/** @param {Study.Participant} participant */
const arrive = (participant) => dispatch({ kind: "participant", participant });
export const refresh = () => inTurn(async () => {
  try {
    arrive(await study.me());
  } catch (error) {
    if (error instanceof ApiError && error.status === 0) dispatch({ kind: "link", link: "lost" });
    else showLoss(error);
  }
});
/** Say so where this browser stands for nobody here any more: they went on elsewhere, or were erased.
 * @param {unknown} error @returns whether it is so */
export function showLoss(error) {
  const isLost = error instanceof ApiError && error.status === 404;
  if (isLost) dispatch({ kind: "problem", text: error.message });
  return isLost;
}
/** Show why a request was refused. A 409 means that another tab was quicker, or the study closed: what holds now is
 * shown, and the server's sentence if nothing moved.
 * @param {unknown} error @param {string | undefined} stage */
async function refused(error, stage) {
  if (!(error instanceof ApiError)) return dispatch({ kind: "notice", text: t("problem.page", "Something went wrong on this page: {error}", { error }) });
  if (error.status === 0) dispatch({ kind: "link", link: "lost" });
  if (showLoss(error)) return;
  const participant = error.status === 409 ? await study.me().catch(() => null) : null;
  if (participant) arrive(participant);
  if (!participant || (participant.stage === stage && !participant.note)) dispatch({ kind: "notice", text: error.message });
}
/** Make a request that was confirmed in a dialog: it waits for the one that is being answered, and is never dropped.
 * @param {() => Promise<Study.Participant>} ask @param {string} [stage] the step is taken from */
export const step = (ask, stage) => inTurn(async () => {
  try {
    arrive(await ask());
    channel?.postMessage("moved");
  } catch (error) {
    await refused(error, stage);
  }
});

/** Make a request that moves the participant on, unless one is being answered.
 * @param {() => Promise<Study.Participant>} ask @param {string} [from] the stage that the step is taken from */
export async function go(ask, from) {
  if (isBusy) return;
  isBusy = true;
  await step(ask, from);
  isBusy = false;
}

const ARRIVAL = `humanplay.study.${name}.arrival`;
const TICKET = `humanplay.study.${name}.ticket`;

const bareAddressBar = () => history.replaceState(history.state, "", bareAddress(location.href));

/** Take what the link held out of the address bar, at once, and keep it in this tab until the server has answered.
 * @returns {string} the part of the address after its question mark */
function takeArrival() {
  const { search } = location;
  const token = ticketIn(location.hash);
  if (search) tabStore.setItem(ARRIVAL, search);
  if (token) tabStore.setItem(TICKET, token);
  if (tabStore.isKept()) bareAddressBar(); // elsewhere a reload needs it until then
  return tabStore.getItem(ARRIVAL) ?? "";
}
const arrival = takeArrival();

/** Come by a link from another device, or as the platform's link says. */
async function enter() {
  const token = tabStore.getItem(TICKET) ?? ticketIn(location.hash);
  if (!token) return study.join(outsideIds(arrival), invitationIn(arrival));
  const participant = await study.goOn({ token }).catch((/** @type {ApiError} */ error) => {
    if (error.status !== 0) tabStore.removeItem(TICKET);
    throw error;
  });
  tabStore.removeItem(TICKET); // a link is used once; whoever has the place goes on without it
  return participant;
}

/** Join the study or go on in it; try again while there is no server.
 * @param {(participant: Study.Participant) => Promise<Study.Participant>} onJoined what comes before the first screen; it returns
 * where the participant stands then */
export async function join(onJoined) {
  try {
    const participant = await enter();
    tabStore.removeItem(ARRIVAL);
    bareAddressBar();
    arrive(await onJoined(participant));
  } catch (error) {
    const { status, message } = /** @type {ApiError} */ (error);
    if (status === 0) {
      dispatch({ kind: "link", link: "lost" });
      setTimeout(() => join(onJoined), 1000);
      return;
    }
    const about = status === 409 ? await study.show().catch(() => null) : null;
    const participant = about?.status === "closed" ? await study.me().catch(() => null) : null;
    if (participant) arrive(participant);
    else dispatch({ kind: "problem", text: message ?? String(error) });
  }
}
