export { Planner, planAll } from "./planner.js";
export { Profile } from "./profile.js";
