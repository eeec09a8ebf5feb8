// Which studies the page /study lists, and what it says of each. No document here, so that node can test it.
import { many } from "../common/words.js";

/** Return the studies that anybody may join now: those by invitation or from a panel are nobody else's.
 * @param {Answers.ListedStudy[]} listed */
export const joinable = (listed) => listed.filter(({ status, recruitment }) => status === "open" && recruitment === "open");

/** @param {Answers.ListedStudy} study @returns how long a study is */
export const lengthLine = ({ warm_up, ranked }) => `${many(warm_up, "episode")} to warm up, then ${ranked} that count${ranked === 1 ? "s" : ""}`;
