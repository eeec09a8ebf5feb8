// @ts-check
// The camera of the 3-D views: the whole map or behind the rover, and effects on or off. The choice holds for both boards.

/** A board with a longer side, cells, is followed until somebody chooses (app/viewer3d/scene.py). */
export const LARGE_SIDE = 30;

/** Return which camera shows a board: the one chosen, else by its size.
 * @param {string | null} choice what is kept in mars.camera @param {number} side the longer one, cells */
export const cameraOf = (choice, side) => (choice === "map" || choice === "follow" ? choice : side > LARGE_SIDE ? "follow" : "map");

/** Fill the group with its buttons; return a function that paints them for a board's longer side.
 * @param {HTMLElement} group @param {Storage} storage @param {() => void} onChange */
export function startCameraControl(group, storage, onChange) {
  let side = 0;
  const button = group.ownerDocument.createElement("button");
  button.type = "button";
  button.className = "quiet view";
  button.dataset.testid = "camera";
  button.addEventListener("click", () => {
    storage.setItem("mars.camera", cameraOf(storage.getItem("mars.camera"), side) === "map" ? "follow" : "map");
    onChange();
  });
  group.append(button);
  return (/** @type {number} */ longer) => {
    side = longer;
    const isMap = cameraOf(storage.getItem("mars.camera"), side) === "map";
    button.textContent = isMap ? "Follow" : "Whole map";
    button.title = isMap ? "Follow the rover in 3-D. Drag the picture to turn it" : "Show the whole map in 3-D. Drag the picture to turn it";
  };
}
