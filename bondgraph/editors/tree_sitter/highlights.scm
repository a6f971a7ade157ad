; `bondgraph editor tree-sitter` puts words of the language in place of names in capitals.
(comment) @comment
(string) @string
(number) @number
(unit) @type
[KEYWORDS] @keyword
[OPERATORS] @keyword.operator
["->" "=>" ".." "<=" ">=" "==" "!=" "<" ">" "-" "+" "*" "/" "^" "="] @operator
["(" ")" "[" "]" "{" "}" (nest_begin)] @punctuation.bracket

(model name: (name) @type)
(parameters name: (name) @type)
(import (name) @type)
(declaration kind: (junction) @type.builtin)
((declaration kind: (name) @type.builtin) (#any-of? @type.builtin KINDS))
((declaration kind: (name) @type) (#not-any-of? @type KINDS))
(declared . (name) @variable)
(experiment name: (name) @variable)
(multibody name: (name) @variable)
((declaration definition: (path . (name) @module .)) (#any-of? @module DOMAINS))
(domain . (name) @module)
(item name: (name) @variable.parameter)
(attribute name: (name) @attribute)
(setting name: (name) @attribute)
(function name: (name) @function)
((call function: (name) @function.builtin) (#any-of? @function.builtin FUNCTIONS))
((call function: (name) @function) (#not-any-of? @function FUNCTIONS))
((path . (name) @constant.builtin .) (#any-of? @constant.builtin VALUES))
