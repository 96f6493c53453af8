export { Planner, planAll } from "./planner.js";
export { Profile } from "./profile.js";
export { Recognizer } from "./recognizer.js";
export { Live } from "./live.js";
export { azurePhones, cartesiaTimings, elevenLabsWords, liveKitWords } from "./timings.js";
