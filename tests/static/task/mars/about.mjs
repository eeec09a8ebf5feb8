// What a server says of MarsExplorer, as the tests of the page's modules need it.

/** @type {Answers.Task} */
export const MARS = {
  name: "mars", title: "MarsExplorer", instructions: "", assets: "mars", actions: ["north", "east", "south", "west"], metrics: [],
  clock: null, keys: { north: ["ArrowUp", "KeyW"], east: ["ArrowRight", "KeyD"], south: ["ArrowDown", "KeyS"], west: ["ArrowLeft", "KeyA"] },
  successes: ["explored"], expert: "ppo", has_boards: true,
};
