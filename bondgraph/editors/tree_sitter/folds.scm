[(block) (parameters) (experiment) (attributes) (resets) (transitions)] @fold
