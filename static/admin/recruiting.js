// @ts-check
// How people come into the study: the code for supervised sessions, and the invitations with their states.
import { create, elementsOf, put } from "../common/page.js";
import { many } from "../common/words.js";
import { ago, invitationCounts, RECRUITMENT } from "./words.js";

/**
 *   ask     sends a body to a path below the study's
 *   run     does work, shows what went wrong, and loads the console again
 * @param {Document} page
 * @param {{ask: <T>(path: string, body: unknown) => Promise<T>,
 *   run: (work: () => Promise<unknown>) => Promise<void>}} how */
export function createRecruiting(page, { ask, run }) {
  const by = elementsOf(page);
  /** @type {Admin.Study | null} */
  let study = null;

  /** @param {string} token */
  const linkOf = (token) => new URL(`study/${encodeURIComponent(study?.name ?? "")}?invitation=${token}`, page.baseURI).href;

  /** @param {string[]} links */
  function show(links) {
    const place = by("links", HTMLTextAreaElement);
    place.value = links.join("\n");
    place.rows = Math.min(8, links.length);
    by("new-links").hidden = links.length === 0;
    if (links.length) place.focus();
    place.select();
  }
  by("invite").addEventListener("submit", (event) => {
    event.preventDefault();
    const count = Number(by("invite-count", HTMLInputElement).value);
    run(async () => {
      /** @type {{tokens: string[]}} */
      const { tokens } = await ask("invitations", { count });
      show(tokens.map(linkOf));
    });
  });
  by("invitations").addEventListener("click", (event) => {
    const button = /** @type {Element} */ (event.target).closest("button");
    const id = button?.dataset.id ?? "";
    if (button?.dataset.act === "link") show([linkOf(button.dataset.token ?? "")]);
    if (button?.dataset.act === "revoke") run(() => ask("invitations/revoke", { ids: [id] }));
  });

  /** @param {Admin.Invitation} invitation @param {number} now_ms */
  function row({ id, state, issued_ms: issued, revoked_ms: revoked, label, at_ms: at, token }, now_ms) {
    const since = state === "revoked" ? revoked : at ?? issued;
    const buttons = token === null ? [] : [
      create("button", "Link", { type: "button", class: "quiet", "data-act": "link", "data-token": token, "aria-label": `Show the link of ${id}` }),
      create("button", "Revoke", { type: "button", class: "quiet danger", "data-act": "revoke", "data-id": id, "aria-label": `Revoke ${id}` })];
    const cells = [create("th", id, { scope: "row" }), create("td", state), create("td", label ?? ""), create("td", ago(now_ms - (since ?? issued)), { class: "number" }), create("td", buttons)];
    return create("tr", cells, { "data-testid": `invitation-${id}`, "data-state": state });
  }

  return {
    /** @param {Admin.Study} shown */
    paint(shown) {
      if (study?.name !== shown.name) show([]);
      study = shown;
      const { recruitment, code, code_until_ms: until, invitations, status, now_ms } = shown;
      put(by("recruitment"), RECRUITMENT[recruitment]);
      by("code-line").hidden = code === null;
      put(by("code"), code ?? "");
      put(by("code-until"), until === null ? "" : `until ${new Date(until).toISOString().slice(0, 10)}, 00:00 UTC`);
      by("invitations-part").hidden = recruitment !== "invitation";
      by("invite").hidden = status !== "open";
      put(by("invitation-counts"), invitations.length ? `${many(invitations.length, "invitation")}: ${invitationCounts(invitations)}.` : "Nobody has been invited yet.");
      const table = by("invitations", HTMLTableElement);
      const key = JSON.stringify([shown.name, invitations.map(({ id, state, label, token }) => [id, state, label, token]), Math.floor(now_ms / 60000)]);
      if (table.dataset.shown === key) return; // a button in focus stays the same button
      table.dataset.shown = key;
      table.tBodies[0].replaceChildren(...invitations.map((each) => row(each, now_ms)));
    },
  };
}
