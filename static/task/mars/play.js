// What the playground has for MarsExplorer alone.
export { createLosses } from "./losses.js";
export { createTerrainDialog } from "./terrain_dialog.js";
export { createViews } from "./views.js";
