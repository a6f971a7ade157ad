"""Table of renderers: the function for each kind of picture or text of each class, imported at its first use."""

from __future__ import annotations

RENDERERS = {
    ("Branch", "plot"): "bondgraph.presentation.plots.phase:plot_branch",
    ("Branch", "summary"): "bondgraph.presentation.text.analyses:branch_text",
    ("Energies", "plot"): "bondgraph.presentation.plots.over_time:plot_energies",
    ("SymbolicEquations", "latex"): "bondgraph.presentation.page.notebook:equations_latex",
    ("Equilibrium", "summary"): "bondgraph.presentation.text.analyses:equilibrium_text",
    ("FeedForward", "plot"): "bondgraph.presentation.plots.over_time:plot_feed_forward",
    ("FeedForward", "summary"): "bondgraph.presentation.text.analyses:feed_forward_text",
    ("Figure", "svg"): "bondgraph.presentation.diagram.svg:svg_text",
    ("Fit", "plot"): "bondgraph.presentation.plots.studies:plot_fit",
    ("Fit", "summary"): "bondgraph.presentation.text.studies:fit_text",
    ("Inversion", "summary"): "bondgraph.presentation.text.analyses:inversion_text",
    ("Linearization", "summary"): "bondgraph.presentation.text.analyses:linearization_text",
    ("Modes", "summary"): "bondgraph.presentation.text.analyses:modes_text",
    ("MonteCarlo", "plot"): "bondgraph.presentation.plots.studies:plot_histograms",
    ("MonteCarlo", "summary"): "bondgraph.presentation.text.studies:montecarlo_text",
    ("MonteCarlo", "tornado"): "bondgraph.presentation.plots.studies:plot_tornado",
    ("Outcome", "plot"): "bondgraph.presentation.plots.sweeps:plot_outcome",
    ("Outcome", "summary"): "bondgraph.presentation.text.analyses:outcome_text",
    ("Response", "plot"): "bondgraph.presentation.plots.bode:plot_response",
    ("Response", "summary"): "bondgraph.presentation.text.analyses:response_text",
    ("ResponseSensitivity", "summary"): "bondgraph.presentation.text.analyses:response_sensitivity_text",
    ("Result", "html"): "bondgraph.presentation.page.notebook:result_html",
    ("Result", "plot"): "bondgraph.presentation.plots.over_time:plot_result",
    ("Result", "plot over"): "bondgraph.presentation.plots.phase:plot_phase",
    ("Result", "summary"): "bondgraph.presentation.text.tables:summary",
    ("RunSensitivity", "summary"): "bondgraph.presentation.text.studies:run_sensitivity_text",
    ("Sensitivity", "summary"): "bondgraph.presentation.text.analyses:sensitivity_text",
}
