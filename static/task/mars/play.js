// What the playground has for MarsExplorer alone.
export { createCosts } from "./costs.js";
export { createTerrainDialog } from "./terrain_dialog.js";
export { createViews } from "./views.js";
