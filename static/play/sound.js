// @ts-check
// Short tones for what happens on one's own board. Off until somebody turns them on.

/** Where the choice is kept: "on" or absent. */
export const SOUND_SETTING = "mars.sound";
/** A pentatonic scale upwards, in semitones: no two of its tones are unpleasant together. */
const SCALE = [0, 2, 4, 7, 9, 12, 14, 16, 19, 21, 24, 26, 28];
const LOWEST_HZ = 262;

/** Return the sound of a new frame of one's own board, or null where nothing is to be heard.
 * @param {Pick<Task, "sound">} task @param {Frame | null | undefined} before @param {Frame | null | undefined} after */
export function soundOf(task, before, after) {
  if (!before || !after || before.episode !== after.episode || after.step <= before.step) return null;
  return task.sound(before, after);
}

/** @param {Sound} sound @returns {Play.Tone[]} the tones of a sound; the more is gained, the higher */
export function tonesOf(sound) {
  const tone = (/** @type {number} */ semitones, /** @type {number} */ at_s, /** @type {Partial<Play.Tone>} */ other = {}) =>
    ({ hertz: LOWEST_HZ * 2 ** (semitones / 12), at_s, for_s: 0.11, wave: /** @type {const} */ ("sine"), loud: 0.1, ...other });
  switch (sound.kind) {
    case "gain": return [tone(SCALE[Math.min(sound.count, SCALE.length) - 1], 0)];
    case "blocked": return [tone(-17, 0, { wave: "triangle", for_s: 0.09, loud: 0.14 })];
    case "crash": return [tone(-12, 0, { wave: "sawtooth", for_s: 0.16, loud: 0.09 }), tone(-19, 0.11, { wave: "sawtooth", for_s: 0.3, loud: 0.09 })];
    case "over": return [tone(4, 0, { for_s: 0.2 }), tone(-5, 0.16, { for_s: 0.3 })];
    case "finish": return [0, 4, 7, 12].map((semitones, index) => tone(semitones, 0.1 * index, { for_s: index === 3 ? 0.4 : 0.14 }));
  }
}

/** Return what plays sounds while the button is pressed.
 * @param {HTMLElement} button @param {{storage: Storage, makeContext: () => AudioContext}} how */
export function createSound(button, { storage, makeContext }) {
  let isOn = storage.getItem(SOUND_SETTING) === "on";
  /** @type {AudioContext | null} */
  let context = null;
  const show = () => button.setAttribute("aria-pressed", String(isOn));

  /** @param {AudioContext} audio @param {Play.Tone} tone */
  function sound(audio, { hertz, at_s, for_s, wave, loud }) {
    const from_s = audio.currentTime + at_s;
    const gain = new GainNode(audio, { gain: 0 });
    gain.gain.setValueAtTime(0, from_s);
    gain.gain.linearRampToValueAtTime(loud, from_s + 0.012);
    gain.gain.exponentialRampToValueAtTime(0.0005, from_s + for_s);
    const source = new OscillatorNode(audio, { type: wave, frequency: hertz });
    source.connect(gain).connect(audio.destination);
    source.start(from_s);
    source.stop(from_s + for_s + 0.02);
  }
  /** @param {Sound | null} what */
  function play(what) {
    if (!isOn || !what) return;
    context ??= makeContext();
    if (context.state === "suspended") context.resume();
    for (const each of tonesOf(what)) sound(context, each);
  }
  button.addEventListener("click", () => {
    isOn = !isOn;
    if (isOn) storage.setItem(SOUND_SETTING, "on");
    else storage.removeItem(SOUND_SETTING);
    show();
    play({ kind: "gain", count: 5 });
  });
  show();
  return { play };
}
