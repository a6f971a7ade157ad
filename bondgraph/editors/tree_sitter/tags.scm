(model name: (name) @name) @definition.class
(experiment name: (name) @name) @definition.function
(function name: (name) @name) @definition.function
(declaration name: (declared . (name) @name)) @definition.field
(declaration kind: (name) @name) @reference.class
