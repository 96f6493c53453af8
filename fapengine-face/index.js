export { Channel } from "./channel.js";
export { FapFace } from "./fap-face.js";
export { parseHead } from "./head.js";
export { Picture } from "./picture.js";
export { Player, parseFap } from "./player.js";
export { Session } from "./session.js";
export { Steering } from "./steering.js";
