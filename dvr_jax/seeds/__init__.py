"""Where the solver starts from: a beam of keyframe candidates, and initial paths through keyframes."""
