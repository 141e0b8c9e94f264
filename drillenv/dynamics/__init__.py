"""How the rig moves. Knows rigs and rocks; no files, no plots, no Gymnasium."""
