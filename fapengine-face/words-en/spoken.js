// Prices, units, years and abbreviations as words: fapengine/voices/spoken_form.py, with its table of English.

import { decade, ordinal, roman, year } from "./numbers.js";
import { SPOKEN } from "./table.js";

const NUMBER_BEFORE = /\d[ \u00a0\u202f]?$/;
const CENTS = /^(.*)[.,](\d\d)$/;
const ADDRESSES = /\b(?:https?:\/\/|www\.)\S+|\b[\w.+-]{1,64}@[\w-]{1,64}\.\w\S*/g;
const FORMS = { year: (found) => year(Number(found)), decade: (found) => decade(Number(found)), roman };
const { currencies, cents, date: dates, short_scales: shortScales, price, units, words, fractions, share, to: between } = SPOKEN;

// Form of a word after a number: the only one; one or other. As a part of a compound (a 5 km walk) it is the first one.
function formOf(forms, number, isPart) {
  const [one, other = one] = forms.split("|");
  if (isPart) return one;
  const [whole, part] = number.replace(/[.,\s](?=\d{3}(?!\d))/g, "").replace(",", ".").split(".");
  return whole === "1" && !part ? one : other;
}

function amount(number, symbol, isPart) {
  const [, before, after] = CENTS.exec(number) ?? [];
  if (before === "0" && cents[symbol]) return `${Number(after)} ${formOf(cents[symbol], String(Number(after)))}`;
  const whole = before ?? number;
  const unit = formOf(currencies[symbol], whole, isPart);
  if (!Number(after ?? 0)) return `${whole} ${unit}`;
  const rest = Number(after) < 10 && cents[symbol] ? ` ${formOf(cents[symbol], String(Number(after)))}` : "";
  return price.replace("{whole}", whole).replace("{unit}", unit).replace("{cents}", Number(after) + rest);
}

function symbolBefore({ groups, indices, index, input }) {
  const { symbol, n, scale, short, to, one } = groups;
  const places = indices.groups;
  if (places.symbol[1] < places.n[0] && NUMBER_BEFORE.test(input.slice(Math.max(index - 2, 0), index))) return []; // 5 € 50
  const many = formOf(currencies[symbol], "5", one !== undefined);
  const second = to && between + to.slice(1);
  for (const [name, said] of [["scale", scale], ["short", short && ` ${shortScales[short]}`], ["to", second]]) {
    if (said) return [[...places.symbol, ""], [...places[name], `${said} ${many}`]];
  }
  return [[...indices[0], amount(n, symbol, one !== undefined)]];
}

function symbolAfter({ groups, indices }) {
  const { symbol, n, scale, one } = groups;
  if (scale) return [[...indices.groups.symbol, formOf(currencies[symbol], "5", one !== undefined)]];
  return [[...indices[0], amount(n, symbol, one !== undefined)]];
}

function unit({ groups, indices }) {
  const { n, x, one } = groups;
  const gap = indices.groups.n[1] === indices.groups.x[0] ? " " : "";
  if (!fractions[n]) return [[...indices.groups.x, gap + formOf(units[x], n, one !== undefined)]];
  return [[...indices.groups.x, `${gap}${fractions[n] === fractions["1/2"] ? "" : `${share} `}${formOf(units[x], "1")}`]];
}

const listed = ({ say, form }) => (match) => {
  const number = form ? FORMS[form](match.groups.n) : "";
  return [[...(match.indices.groups?.x ?? match.indices[0]), say.replace(/{(\d)}/g, (_, group) => (group === "0" ? number : match[group]))]];
};

function phone({ 0: found, index }) {
  const parts = [...found.matchAll(/\d+|[/.-]/g)];
  return parts.map(({ 0: part, index: at }) => [index + at, index + at + part.length, /\d/.test(part) ? [...part].join(" ") : " "]);
}

// 2024-05-12 and 11/28/2026 are dates; 05/12/2024 may be one of two, and stays.
function date({ 0: found, groups, indices }) {
  let [day, month] = [Number(groups.day ?? groups.d), Number(groups.month ?? groups.m)];
  if (!groups.year && month > 12 && day <= 12) [day, month] = [month, day];
  else if (!groups.year && day <= 12) return [[...indices[0], found]];
  if (!(day >= 1 && day <= 31 && month >= 1 && month <= 12)) return [];
  const said = { day: ordinal(day), month: dates.months[month - 1], year: year(Number(groups.year ?? groups.y)) };
  return [[...indices[0], dates.said.replace(/{(\w+)}/g, (_, name) => said[name])]];
}

const edits = {
  date, phone,
  before: symbolBefore, after: symbolAfter, unit,
  fraction: ({ 0: found, indices }) => [[...indices[0], fractions[found]]],
  word: ({ 0: found, indices }) => [[...indices[0], words[found]]],
};
const RULES = SPOKEN.patterns.map(({ kind, find, ...rest }) => [new RegExp(find, "dg"), edits[kind] ?? listed(rest)]);

// What is said in place of a stretch, shared out among its words, in order.
function sharedOut(text, [start, stop, said]) {
  const found = [...text.slice(start, stop).matchAll(/\S+/g)];
  const spoken = said.split(/\s+/).filter(Boolean);
  if (found.length < 2 || spoken.length < found.length) return [[start, stop, said]];
  const ends = found.map((_, index) => Math.round(((index + 1) * spoken.length) / found.length));
  return found.map((word, index) => [
    start + word.index, start + word.index + word[0].length, spoken.slice(ends[index - 1] ?? 0, ends[index]).join(" "),
  ]);
}

// What is said for each of some words that follow each other.
export function spokenForms(texts) {
  const text = texts.join(" ");
  const taken = new Uint8Array(text.length);
  for (const { 0: address, index } of text.matchAll(ADDRESSES)) taken.fill(1, index, index + address.length);
  const made = [];
  for (const [pattern, edit] of RULES) {
    for (const match of text.matchAll(pattern)) {
      const found = edit(match).flatMap((one) => sharedOut(text, one));
      if (found.some(([start, stop]) => taken.subarray(start, stop).some(Boolean))) continue;
      made.push(...found);
      for (const [start, stop] of found) taken.fill(1, start, stop);
    }
  }
  made.sort(([one], [other]) => one - other);
  let at = 0;
  return texts.map((word) => {
    const [start, stop] = [at, at + word.length];
    at = stop + 1;
    let [said, done] = ["", start];
    for (const [from, to, instead] of made) {
      if (from < start || from >= stop) continue;
      said += text.slice(done, from) + instead;
      done = to;
    }
    const last = made.find(([from, to]) => from < start && to > start); // what was said before stands for this word, too
    return last ? text.slice(Math.min(last[1], stop), stop) : said + text.slice(done, stop);
  });
}
