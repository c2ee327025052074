"""All hard scenes: a line for each of what must come out and what came; exit status 1 where one falls short.

python tests/hard_scenes/report.py             all of them
python tests/hard_scenes/report.py grooves     those with this text in their stage or name
"""

import sys

import chain_scenes
import contact_scenes
import flow_scenes
import groove_scenes
import real_seal_scenes
import seal_scenes

SCENES = (
    *contact_scenes.SCENES,
    *flow_scenes.SCENES,
    *seal_scenes.SCENES,
    *groove_scenes.SCENES,
    *chain_scenes.SCENES,
    *real_seal_scenes.SCENES,
)


def main(text="", scenes=SCENES):
    """Solve the scenes and return the exit status."""
    chosen = [scene for scene in scenes if text in f"{scene.stage} {scene.name}"]
    short = 0
    for scene in chosen:
        within, came = scene.outcome()
        short += not within
        verdict = "yes" if within else "NO "
        print(f"{verdict} {scene.stage}: {scene.name}: {scene.must.text}; came {came}", flush=True)
    print(f"{len(chosen)} scenes, {short or 'none'} short")
    return 1 if short or not chosen else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
