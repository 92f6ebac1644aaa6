//! Every figure that README and the pages quote has a source and is what that says. The cheap ones are made again
//! (`made`); long commands leave what they print in `docs/recorded/` (`recorded`), and `docs/record` runs them again.
//! A table of figures for which there is neither fails, unless `elsewhere` says what else it is. In running text a
//! number with a unit (`prose`) may also be a constant of the code (`constants`) or one that nobody measured (`given`).

mod boards;
mod constants;
mod elsewhere;
mod given;
mod made;
mod page;
mod prose;
mod recorded;
mod text;

use page::Pages;

#[test]
fn every_figure_that_is_quoted_has_a_source_that_says_so() {
    let pages = Pages::new();
    let checks = [made::CHECKS, recorded::CHECKS, boards::CHECKS].concat();
    std::thread::scope(|scope| {
        let pages = &pages;
        let started: Vec<_> = checks.into_iter().map(|check| scope.spawn(move || check(pages))).collect();
        for check in started {
            if check.join().is_err() {
                pages.wrong("a check could not end: above it says why".into());
            }
        }
    });
    constants::check(&pages);
    given::check(&pages);
    pages.check_tables(elsewhere::is);
    pages.check_prose();
    elsewhere::check(&pages);
    pages.finish();
}
