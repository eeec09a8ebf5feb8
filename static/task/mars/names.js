// Plain names of policies and levels, as pages say them; forms and addresses keep the technical ones. No document here.

/** @type {Readonly<Record<string, string>>} */
const POLICIES = Object.freeze({
  ppo: "Expert", "frontier-cost": "Nearest", "frontier-utility": "Greedy", "frontier-priced": "Tidy",
  lookahead: "Expert that knows how terrains are made", random: "Random",
});
/** @type {Readonly<Record<string, string>>} */
const LEVELS = Object.freeze({ "1-1-1": "Open", random: "Scattered", "3-2-1": "Boulders", building: "Building", cave: "Cave" });

/** @param {string} policy @returns its plain name, or the technical one of a policy that came with somebody's own file */
export const policyName = (policy) => POLICIES[policy] ?? policy;
/** @param {string} level @returns its plain name, or the paper's code */
export const levelName = (level) => LEVELS[level] ?? level;

/** Return the levels as the dialog offers them: those with plain names, then the others under the paper's codes.
 * @param {string[]} levels */
export const levelGroups = (levels) => ({
  plain: Object.keys(LEVELS).filter((level) => levels.includes(level)),
  paper: levels.filter((level) => !(level in LEVELS)),
});
