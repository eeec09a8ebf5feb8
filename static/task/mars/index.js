// @ts-check
// MarsExplorer on the page: all that is drawn and said of rovers, lidar, rocks and maps.
import * as board from "./board.js";
import * as course from "./course.js";
import { ahead } from "./ground.js";
import * as words from "./words.js";

/** What a server says that has this task alone.
 * @type {TaskAbout} */
const ABOUT = {
  name: "mars", title: "MarsExplorer", assets: "mars", actions: ["north", "east", "south", "west"], metrics: [],
  keys: { north: ["ArrowUp", "KeyW"], east: ["ArrowRight", "KeyD"], south: ["ArrowDown", "KeyS"], west: ["ArrowLeft", "KeyA"] },
};

/** @param {TaskAbout} [about] @returns {Task} */
export function taskOf(about = ABOUT) {
  return { ...about, ...board, ...course, ...words, ahead, order: ["north", "west", "south", "east"], play: () => import("./play.js") };
}
