// MarsExplorer on the page: all that is drawn and said of rovers, lidar, rocks and maps.
import { paint } from "./board.js";
import { adviceText, boardAt, courseOf, paintEvents, progressAt } from "./course.js";
import { ahead } from "./ground.js";
import { firstWish, isInformed, lines, policyName, words } from "./words.js";

/** @param {Answers.Task} about @returns {Mars.Task} */
export const taskOf = (about) => ({
  ...about, ...words, nameOf: policyName, lines, isInformed, firstWish, order: ["north", "west", "south", "east"], paint, ahead, courseOf, boardAt, progressAt, paintEvents, adviceText,
  costsInWords: async (costs) => (await import("./cost_words.js")).costsInWords(costs),
  mark: ({ position }) => position,
  progress: ({ discovered, cells }) => discovered / cells,
  path: ({ positions, discovered }, { cells }) => ({ trail: positions, progress: discovered.map((count) => count / cells) }),
  shape: ({ rows, cols }) => [cols, rows],
  parts: { views: () => import("./views.js"), terrains: () => import("./terrain_dialog.js"), costs: () => import("./costs.js") },
});
