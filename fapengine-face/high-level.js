// FAP 1 and 2, visemes and expressions, as the low-level FAPs that show them. The same rules as
// fapengine/trajectory/high_level.py; the faces are those of its default profile: design/high_level_faces.py writes them.
import { EXPRESSION_FACES, VISEME_FACES } from "./high-level-faces.js";

const FULL = 63; // blend or intensity of one face alone

export class HighLevelFaps {
  constructor() {
    [this.visemes, this.expressions] = [VISEME_FACES, EXPRESSION_FACES].map((faces) => faces.map((face) => [...face]));
    this.viseme = null;
    this.expression = null;
    this.isBase = false; // init_face: low-level FAPs are added to the expression
  }

  // values: 68 numbers; sent: 68 booleans, those of FAP 1 and 2 first; viseme: 4 numbers; expression: 6.
  // Returns 68 numbers.
  show(values, sent, viseme, expression) {
    const lowLevel = values.map((_, column) => column > 1 && sent[column]);
    const define = (face, scale) => lowLevel.forEach((isSent, column) => isSent && (face[column] = values[column] * scale));
    if (sent[0]) {
      const [first, second, , isDefinition] = viseme;
      checkSelects("viseme", [first, second], this.visemes);
      const blend = clipped(viseme[2]);
      if (isDefinition) define(this.visemes[2 * blend > FULL ? first : second], 1);
      this.viseme = mix(this.visemes[first], blend, this.visemes[second], FULL - blend);
    }
    if (sent[1]) {
      const [first, , second, , isBase, isDefinition] = expression;
      checkSelects("expression", [first, second], this.expressions);
      const [intensity, other] = [clipped(expression[1]), clipped(expression[3])];
      this.isBase = Boolean(isBase);
      if (isDefinition && intensity) define(this.expressions[first], FULL / intensity);
      this.expression = mix(this.expressions[first], intensity, this.expressions[second], other);
    }
    return values.map((value, column) => {
      const base = this.expression?.[column] ?? 0;
      if (lowLevel[column]) return value + (this.isBase ? base : 0);
      return Math.round(base + (this.viseme?.[column] ?? 0));
    });
  }
}

const clipped = (weight) => Math.min(Math.max(weight, 0), FULL);

function checkSelects(what, selects, faces) {
  const wrong = selects.find((select) => !(select in faces));
  if (wrong !== undefined) throw new Error(`FAP file: got ${what} ${wrong}, expected 0 to ${faces.length - 1}`);
}

function mix(face, weight, other, otherWeight) {
  return face.map((value, column) => (weight * value + otherWeight * other[column]) / FULL);
}
