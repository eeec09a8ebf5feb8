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

/** @param {string[]} names @returns the policy that a newcomer plays with */
export function favourite(names) {
  return names.find((name) => name.includes("ppo")) ?? names.find((name) => name === "frontier-utility") ?? names.at(-1) ?? "";
}

/** Return what is played until somebody chooses.
 * @param {{name: string}[]} policies @returns {Play.Wish} */
export function firstWish(policies) {
  const names = policies.map(({ name }) => name);
  const rival = favourite(names);
  const player = names.find((name) => name !== rival && name.includes("frontier")) ?? rival;
  return { level: "random", map: null, size: 21, seed: null, rival, player };
}
