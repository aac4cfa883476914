// Order of the results of the site's search: guides first, then reference and development, then names of the program.
const later = /(api|options|equations|verification|comparison|speed|challenge|architecture|extending|CONTRIBUTING|CHANGELOG)$/;

var Scorer = {
  score: ([page, title, anchor, text, score, file, kind]) =>
    score - (kind === "object" ? 200 : later.test(page) ? 100 : 0),
  // Sphinx's own numbers:
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
