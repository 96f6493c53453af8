"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const sliders = [...document.querySelectorAll(".row input")];
const drawn = ["front", "side"].map((name) => document.getElementById(name));
const weights = () => sliders.map((slider) => Number(slider.value));
const place = (values) => data.rest.map((rest, point) => rest.map((mm, axis) =>
  mm + values.reduce((sum, weight, mode) => sum + weight * data.modes[mode][point][axis], 0)));
const curve = (points) => points.map((point, n) => { // a closed line without corners (Catmull and Rom)
  const at = (offset) => points[(n + offset + points.length) % points.length];
  const [a, b, c] = [at(-1), at(1), at(2)];
  const one = point.map((mm, k) => mm + (b[k] - a[k]) / 6), two = b.map((mm, k) => mm - (c[k] - point[k]) / 6);
  return `${n ? "" : "M" + point} C ${one} ${two} ${b}`;
}).join(" ") + "Z";
function draw() {
  const points = place(weights());
  const flat = [points.map(([x, y]) => [x, -y]), points.map(([, y, z]) => [z - data.rest[0][2], -y])];
  flat.forEach((seen, view) => {
    const ring = (indices) => indices.length > 3 ? curve(indices.map((index) => seen[index])) : "";
    drawn[view].querySelector(".outer").setAttribute("d", ring(data.outer));
    drawn[view].querySelector(".inner").setAttribute("d", ring(data.inner));
    drawn[view].querySelectorAll("circle").forEach((dot, n) => {
      dot.setAttribute("cx", seen[n][0]);
      dot.setAttribute("cy", seen[n][1]);
    });
  });
  for (const slider of sliders) slider.parentElement.querySelector("output").value = Number(slider.value).toFixed(1);
  document.getElementById("weights").value = weights().map((weight) => weight.toFixed(2)).join(" ");
}
function show(values) {
  sliders.forEach((slider, n) => { slider.value = values[n]; });
  draw();
}
sliders.forEach((slider) => slider.addEventListener("input", draw));
document.querySelectorAll("button").forEach((button) =>
  button.addEventListener("click", () => show(data.looks[button.dataset.look])));
draw();
