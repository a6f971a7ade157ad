"""Table of renderers: the function for each kind of picture or text of each class, imported at its first use."""

from __future__ import annotations

RENDERERS = {
    ("Branch", "plot"): "bondgraph.views.phase:plot_branch",
    ("Branch", "summary"): "bondgraph.views.analyses:branch_text",
    ("Energies", "plot"): "bondgraph.views.energies:plot_energies",
    ("Equations", "latex"): "bondgraph.page.notebook:equations_latex",
    ("Equilibrium", "summary"): "bondgraph.views.analyses:equilibrium_text",
    ("FeedForward", "plot"): "bondgraph.views.feed_forward:plot_feed_forward",
    ("FeedForward", "summary"): "bondgraph.views.feed_forward:feed_forward_text",
    ("Figure", "svg"): "bondgraph.diagram.svg:svg_text",
    ("Fit", "plot"): "bondgraph.views.study_plots:plot_fit",
    ("Fit", "summary"): "bondgraph.views.studies:fit_text",
    ("Inversion", "summary"): "bondgraph.views.analyses:inversion_text",
    ("Linearization", "summary"): "bondgraph.views.analyses:linearization_text",
    ("Modes", "summary"): "bondgraph.views.analyses:modes_text",
    ("MonteCarlo", "plot"): "bondgraph.views.study_plots:plot_histograms",
    ("MonteCarlo", "summary"): "bondgraph.views.studies:montecarlo_text",
    ("MonteCarlo", "tornado"): "bondgraph.views.study_plots:plot_tornado",
    ("Outcome", "plot"): "bondgraph.views.sweep_plot:plot_outcome",
    ("Outcome", "summary"): "bondgraph.views.analyses:outcome_text",
    ("Response", "plot"): "bondgraph.views.bode:plot_response",
    ("Response", "summary"): "bondgraph.views.analyses:response_text",
    ("ResponseSensitivity", "summary"): "bondgraph.views.analyses:response_sensitivity_text",
    ("Result", "html"): "bondgraph.page.notebook:result_html",
    ("Result", "plot"): "bondgraph.views.plots:plot_result",
    ("Result", "plot over"): "bondgraph.views.phase:plot_phase",
    ("Result", "summary"): "bondgraph.views.tables:summary",
    ("RunSensitivity", "summary"): "bondgraph.views.studies:run_sensitivity_text",
    ("Sensitivity", "summary"): "bondgraph.views.analyses:sensitivity_text",
}
