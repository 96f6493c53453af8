// English numbers in words.

const SMALL = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen"];
const TENS = ["", "", "twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"];
const SCALES = ["", " thousand", " million", " billion", " trillion"];
const ORDINALS = { one: "first", two: "second", three: "third", five: "fifth", eight: "eighth", nine: "ninth", twelve: "twelfth" };
const MOST = 10 ** (3 * SCALES.length);

const digits = (text) => [...text].map((digit) => SMALL[digit]).join(" ");

function underThousand(number) {
  const [hundreds, rest] = [Math.floor(number / 100), number % 100];
  const words = hundreds ? [SMALL[hundreds], "hundred"] : [];
  if (rest && hundreds) words.push("and");
  if (rest >= 20) words.push(TENS[Math.floor(rest / 10)]);
  const one = rest < 20 ? rest : rest % 10;
  if (one) words.push(SMALL[one]);
  return words.join(" ");
}

export function cardinal(number) {
  if (!number) return SMALL[0];
  const parts = [];
  for (let [left, scale] = [number, 0]; left; left = Math.floor(left / 1000), ++scale) {
    const part = left % 1000;
    const joint = !scale && part < 100 && number > 999 ? "and " : "";
    if (part) parts.unshift(joint + underThousand(part) + SCALES[scale]);
  }
  return parts.join(" ");
}

export function ordinal(number) {
  const words = cardinal(number).split(" ");
  const last = words.pop();
  return [...words, ORDINALS[last] ?? `${last.replace(/y$/, "ie")}th`].join(" ");
}

export function year(number) {
  const [century, rest] = [Math.floor(number / 100), number % 100];
  if (number < 1000 || number > 9999 || (century % 10 === 0 && rest < 10)) return cardinal(number);
  const after = rest === 0 ? "hundred" : rest < 10 ? `oh ${SMALL[rest]}` : cardinal(rest);
  return `${cardinal(century)} ${after}`;
}

export function decade(number) {
  const words = year(number);
  return words.endsWith("y") ? `${words.slice(0, -1)}ies` : `${words}s`;
}

const VALUES = { I: 1, V: 5, X: 10 };

export function roman(letters) {
  const values = [...letters].map((letter) => VALUES[letter]);
  return values.reduce((total, value, index) => total + (value < Math.max(...values.slice(index)) ? -value : value), 0);
}

// onTheHour: what follows the hour then.
export function clock(hour, minutes, onTheHour) {
  const after = minutes === 0 ? onTheHour : minutes < 10 ? `oh ${SMALL[minutes]}` : cardinal(minutes);
  return `${cardinal(hour)} ${after}`.trim();
}

// A number as it is written, 1,234.5: in words.
export function inWords(written) {
  const [whole, part] = written.replace(/,/g, "").split(".");
  const isCode = (whole.length > 1 && whole.startsWith("0")) || Number(whole) >= MOST;
  return `${isCode ? digits(whole) : cardinal(Number(whole))}${part ? ` point ${digits(part)}` : ""}`;
}
