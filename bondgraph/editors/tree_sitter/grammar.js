// The grammar of the .bg language for editors: what each piece of a text is, also while it is typed. What a file means, only the compiler knows.
//
// A line break is a token where a statement may end, and white space elsewhere. A line that begins with an operator goes on with the one
// before, so operators take the breaks before them. Words are names where nothing that they begin can follow. `bondgraph editor tree-sitter`
// puts the words of the analyses in place of ANALYSES.

const BREAKS = /\n([ \t\r\n]|#[^\n]*\n)*/;
const sign = (text) => alias(token(prec(2, choice(text, seq(BREAKS, text)))), text);
const word = (text) => choice(text, alias(token(prec(2, seq(BREAKS, text, /[ \t]/))), text));
const listed = (rule) => seq(rule, repeat(seq(sign(","), rule)));
const braces = (rule, end) => seq("{", optional(seq(rule, repeat(seq(end, rule)), optional(end))), "}");
const LISTS = ["parameter", "constant", "input", "output", "signal"];

module.exports = grammar({
  name: "bondgraph",
  word: ($) => $.name,
  extras: ($) => [/[ \t\r]/, $._blank, $.comment],
  rules: {
    file: ($) => optional(seq($._top, repeat(seq($._end, $._top)), optional($._end))),
    _top: ($) => choice($.model, $.import, $.quantities, $.function, $.parameters, $.string),
    import: ($) => seq("import", listed($.name), "from", choice($.string, $.name)),
    parameters: ($) => seq("parameters", field("name", $.name), braces(choice($.item, $.string), $._end)),
    model: ($) => seq(optional("plain"), "model", field("name", $.name), $.block),
    block: ($) => braces($._statement, $._end),
    _end: ($) => repeat1(choice(";", $._break)),
    _break: () => token(prec(1, "\n")),
    _blank: () => "\n",
    _separator: ($) => repeat1(choice(sign(","), ";", $._break)),

    _statement: ($) => choice(
      $.quantities, $.function, $.modes, $.solve, $.ports, $.declaration, $.bonds, $.multibody, $.loop, $.conditional, $.event, $.requirement,
      $.experiment, $.string, $.continued,
    ),
    quantities: ($) => seq(choice(...LISTS), listed($.item)),
    modes: ($) => seq("mode", listed($.item), optional($.transitions)),
    transitions: ($) => braces($.transition, $._end),
    transition: ($) => seq(listed($.name), sign("->"), $.name, "when", $._expression, optional($.resets)),
    item: ($) => seq(field("name", $.name), optional($.index), optional(seq(sign(":"), choice($.unit, $.choices))), optional(seq(sign("="), $._expression)), optional($.string)),
    choices: ($) => seq("{", listed($.name), "}"),
    function: ($) => seq("function", field("name", $.name), "(", listed($.name), ")", sign("="), $._expression),
    solve: ($) => seq("solve", $.law, "for", listed($.item)),
    ports: ($) => seq("port", listed(seq(field("name", $.name), optional($.index), optional($.components), optional(seq(sign(":"), $.domain)), optional($.string)))),
    domain: ($) => seq($.name, optional($.index)),
    declaration: ($) => seq(
      field("kind", choice($.name, $.junction)), listed(field("name", $.declared)), optional(seq(sign(":"), field("definition", $._definition))),
      optional($.attributes), optional($.string),
    ),
    declared: ($) => seq($.name, optional($.index), optional($.components)),
    components: ($) => seq("(", listed(seq($.name, optional(seq(sign(":"), $.domain)))), ")"),
    _definition: ($) => choice($._expression, $.law, $.link),
    law: ($) => listed($.equation),
    equation: ($) => seq($._expression, sign("="), $._expression),
    link: ($) => seq($._expression, "to", $._expression),
    attributes: ($) => braces($.attribute, $._separator),
    attribute: ($) => seq(field("name", $.name), optional($.path), sign("="), $._expression),

    bonds: ($) => seq(listed(choice($.nest, alias($._first, $.path))), repeat1(seq($.arrow, listed($._place)))),
    _first: ($) => seq(choice($.name, ...[...LISTS, "function", "mode", "port", "multibody", "experiment"].map((w) => alias(w, $.name))), repeat(choice($.index, $.member))),
    _place: ($) => choice($.path, $.nest),
    nest: ($) => seq($.nest_begin, listed($._place), ")"),
    nest_begin: () => /[01]\(/,
    junction: () => /[01]/,
    arrow: () => choice(sign("->"), sign("=>")),
    path: ($) => prec.left(seq($.name, repeat(choice($.index, $.member)))),
    member: ($) => seq(".", $.name),
    index: ($) => seq("[", listed($._expression), "]"),

    multibody: ($) => seq("multibody", field("name", $.name), optional($.index), optional(seq(sign(":"), $.name)), alias($._mechanism, $.block)),
    _mechanism: ($) => braces(choice($.declaration, $.quantities, $.setting, alias($._part_loop, $.loop), alias($._part_conditional, $.conditional), $.string), $._end),
    setting: ($) => seq(field("name", $.name), sign("="), $._expression),
    loop: ($) => seq("for", $.name, "in", $.range, $.block),
    conditional: ($) => seq("if", $._expression, $.block, optional(seq(word("else"), choice($.block, $.conditional)))),
    _part_loop: ($) => seq("for", $.name, "in", $.range, alias($._mechanism, $.block)),
    _part_conditional: ($) => seq("if", $._expression, alias($._mechanism, $.block), optional(seq(word("else"), choice(alias($._mechanism, $.block), alias($._part_conditional, $.conditional))))),
    continued: ($) => seq("if", $._expression, word("else"), $._expression, optional($.string)),  // of the line before
    event: ($) => choice(seq("when", $._expression, $.resets), seq("every", $._expression, repeat($.timing), $.resets)),
    timing: ($) => seq(choice("offset", "delay", "jitter", "seed"), $._expression),
    requirement: ($) => seq("require", $._expression, optional($.string)),
    resets: ($) => braces($.wish, $._separator),
    wish: ($) => seq($.path, sign("="), choice($._expression, $.range)),

    experiment: ($) => seq("experiment", field("name", $.name), braces($._step, $._end)),
    _step: ($) => choice($.setting_step, $.sweep, $.simulate, $.bandwidth, $.stop, $.analysis, $.report, $.string),
    setting_step: ($) => seq(choice("set", "start"), $.path, sign("="), $._expression),
    sweep: ($) => seq("sweep", $.path, optional(seq(sign(":"), $.unit)), sign("="), listed($._expression)),
    simulate: ($) => seq("simulate", $.range, optional($.attributes)),
    bandwidth: ($) => seq("bandwidth", $._expression),
    stop: ($) => seq("stop", "when", $._expression),
    report: ($) => seq("report", listed(seq($._expression, optional(seq("in", $.unit))))),
    analysis: ($) => seq(field("word", choice(ANALYSES)), optional(listed($._target)), optional(seq("to", listed($._target))), optional(seq("over", $.range)), optional($.attributes)),
    _target: ($) => choice($.path, seq($.path, sign("/"), $.path), $.wish, $.correlation, $.string),
    correlation: ($) => seq($.name, "(", $.path, sign(","), $.path, ")", sign("="), $._expression),
    range: ($) => seq($._expression, sign(".."), $._expression),

    _expression: ($) => choice($.binary, $.chosen, $.unary, $.quantity, $.path, $.call, $.bracket, $.vector, $.string),
    binary: ($) => choice(
      ...[[2, word("or")], [3, word("and")], [5, sign("+")], [5, sign("-")], [6, sign("*")], [6, sign("/")], [8, sign("^")],
        ...["<=", ">=", "==", "!=", "<", ">"].map((s) => [4, sign(s)])].map(([n, s]) => prec.left(n, seq($._expression, s, $._expression))),
    ),
    chosen: ($) => prec.right(1, seq($._expression, "if", $._expression, word("else"), $._expression)),
    unary: ($) => prec(7, seq(choice(sign("-"), "not"), $._expression)),
    call: ($) => seq(field("function", $.name), "(", optional(listed($._expression)), ")"),
    bracket: ($) => seq("(", $._expression, ")"),
    vector: ($) => choice(seq("(", $._expression, repeat1(seq(sign(","), $._expression)), ")"), seq("[", listed($._expression), "]")),
    quantity: ($) => seq($.number, optional(choice(alias($.name, $.unit), alias($.symbol, $.unit), seq("[", $.unit, "]")))),
    unit: ($) => prec.left(seq($._factor, repeat(seq(choice(sign("*"), sign("/")), $._factor)))),
    _factor: ($) => choice($.number, seq(choice($.name, $.symbol, seq("(", $.unit, ")")), optional(seq(sign("^"), $._exponent)))),
    _exponent: ($) => choice(seq(optional(sign("-")), $.number), seq("(", optional(sign("-")), $.number, sign("/"), $.number, ")")),

    name: () => /[A-Za-z_][A-Za-z_0-9]*/,
    symbol: () => /%|[A-Za-z]*[\u00b5\u03bc\u03a9\u2126][A-Za-z\u03a9\u2126]*/,
    number: () => /[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?/,
    string: () => /"[^"\n]*"/,
    comment: () => /#[^\n]*/,
  },
});
