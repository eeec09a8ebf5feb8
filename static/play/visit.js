// Marks the page before it is painted for the first time: a first visit has one board, and a touch screen has arrow buttons. A plain
// script at the start of the body, so that nothing moves once the modules run.
{
  const { body } = document;
  /** @param {string} key */
  const kept = (key) => {
    try {
      return localStorage.getItem(key);
    } catch {
      return null; // a browser that keeps nothing
    }
  };
  const isFirst = kept("humanplay.visited") === null;
  body.dataset.visit = isFirst ? "first" : "again";
  body.dataset.knows = String(Number(kept("humanplay.played")) >= 3);
  body.dataset.boards = isFirst ? "1" : "2";
  body.dataset.fresh = String(!location.search.includes("mode=watch"));
  body.dataset.pad = kept("humanplay.pad") ?? String(matchMedia("(pointer: coarse), (max-width: 700px)").matches);
}
