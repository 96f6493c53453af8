#!/usr/bin/env bash
# Score the lip syncs of a pull request, or of the whole checkout. Environment: FILES, PHONES, AUDIO, TEXT, FAIL_UNDER as
# the action's inputs, BASE the commit to compare with (empty: all files), RUNNER_TEMP, GITHUB_OUTPUT, GITHUB_STEP_SUMMARY.
set -euo pipefail
set -f  # git, not the shell, expands the patterns
read -r -d "" -a patterns <<< "$FILES" || true  # blanks and line ends separate them
listed="$RUNNER_TEMP/lips.list"  # a file, as a pipe would hide that git failed
if [[ -n "${BASE:-}" ]]; then
  git cat-file -e "$BASE^{commit}" 2> /dev/null || git fetch --no-tags --depth=1 origin "$BASE"
  git diff --name-only -z --diff-filter=d "$BASE" HEAD -- "${patterns[@]}" > "$listed"
else
  git ls-files -z -- "${patterns[@]}" > "$listed"
fi
mapfile -d '' files < "$listed"
if [[ ${#files[@]} -eq 0 ]]; then
  echo "No lip sync to check."
  exit 0
fi
junit="$RUNNER_TEMP/lips.xml" sarif="$RUNNER_TEMP/lips.sarif"
options=(--check --junit "$junit" --sarif "$sarif")
[[ -z "${PHONES:-}" ]] || options+=(--phones "$PHONES")
[[ -z "${AUDIO:-}" ]] || options+=(--audio "$AUDIO")
[[ -z "${TEXT:-}" ]] || options+=(--transcript-file "$TEXT")
[[ -z "${FAIL_UNDER:-}" ]] || options+=(--fail-under "$FAIL_UNDER")
code=0
said="$(fapengine score "${options[@]}" -- "${files[@]}")" || code=$?
echo "$said"
printf '```text\n%s\n```\n' "$said" >> "$GITHUB_STEP_SUMMARY"
for name in junit sarif; do
  [[ ! -e "${!name}" ]] || echo "$name=${!name}" >> "$GITHUB_OUTPUT"
done
exit "$code"
