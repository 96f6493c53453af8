"""Amounts, units, ordinals, years and abbreviations as words, in sixteen languages, and whose words they are."""

import re
import subprocess
import sys
import tomllib
from importlib.resources import files

import pytest

from fapengine.speech.marks import words_of
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.spoken_form import LANGUAGES, _rules, spoken_form

CASES = [
    ("de", "Es kostet nur 1 €, mit 1 €; sie kauft 1 Apfel und 1 Birne, er wartet 1 Tag. 1½ Stunden, ½ Liter, 1 Mio. €",
     "Es kostet nur einen Euro, mit einem Euro; sie kauft einen Apfel und eine Birne, er wartet einen Tag. "
     "anderthalb Stunden, ein halber Liter, eine Million Euro"),
    ("en-us", "½ cup, 1½ hours, 2 1/2 cups, ¾ mi, 1¼ mi, $3–5, 1/8",
     "one half cup, 1 and a half hours, 2 and a half cups, three quarters of a mile, 1 and a quarter miles, "
     "3 to 5 dollars, one eighth"),
    ("fr-fr", "François Ier, 1½ heure, 2½ heures, ½ tasse, 3–5 jours, ¾ d'heure, 2½ kg, 1 1/2 h, 1½ litre.",
     "François premier, une heure et demie, 2 heures et demie, une demi-tasse, 3 à 5 jours, trois quarts d'heure, "
     "2 kilos et demi, une heure et demie, un litre et demi."),
    ("es", "½ litro, ½ hora, 1½ horas, 2½ kg, 3-5 €, 1 ½ h, 2 1/4 km, 2½ años",
     "medio litro, media hora, una hora y media, 2 kilos y medio, 3 a 5 euros, una hora y media, "
     "2 kilómetros y cuarto, 2 años y medio"),
    ("it", "½ litro, ½ ora, 1½ ore, 3-5 giorni, 2½ kg, 3½ €",
     "mezzo litro, mezz'ora, un'ora e mezza, 3 a 5 giorni, 2 chili e mezzo, 3 euro e mezzo"),
    ("pt", "½ litro, 2½ horas, 1½ hora, 2½ kg", "meio litro, 2 horas e meia, uma hora e meia, 2 quilos e meio"),
    ("ru", "½ литра, 1½ часа, 2½ км, глава IV",
     "половина литра, полтора часа, 2 с половиной километра, глава четвёртая"),
    ("pl", "½ litra, 1½ godziny", "pół litra, półtorej godziny"),
    ("de", "2½ min", "zweieinhalb Minuten"),
    ("fr-fr", "À 1½ km/h, 5 km/h ou 3½ m/s, 2½ m².", "À 1 kilomètre et demi par heure, 5 kilomètres par heure ou "
     "3 mètres et demi par seconde, 2 mètres carrés et demi."),
    ("en-us", "A 2.4 m ceiling, 2.4 m high; a 5 km run of 5 km, an 8 lb bag, a 1½ mi walk, a 30 s clip, 5 m wide",
     "A 2.4 metre ceiling, 2.4 metres high; a 5 kilometre run of 5 kilometres, an 8 pound bag, "
     "a 1 and a half mile walk, a 30 second clip, 5 metres wide"),
    ("en-us", "A $5 bill, a $3.50 tea, a $5 million house, a 10 € note, an $8–10 tip; $5 million, 10 €",
     "A 5 dollar bill, a 3 dollar 50 tea, a 5 million dollar house, a 10 euro note, "
     "an 8 to 10 dollar tip; 5 million dollars, 10 euros"),
    ("en-us", "2 1/2 kg", "2 and a half kilograms"),
    ("cmn", "1½杯，½kg", "1又二分之一杯，二分之一公斤"),
    ("sw", "½ kg, 1½ km", "nusu kilo, kilomita 1 na nusu"),
    ("es", "El 21.º piso, el 3º de la lista, el 3.er día; el piso 21.º es caro.",
     "El vigésimo primer piso, el tercero de la lista, el tercer día; el piso vigésimo primero es caro."),
    ("es", "En 1901 había 1.200 personas, 221.000 casas y 21 libros a 21 €, 200 £; espera 1 hora y 31 min.",
     "En 1901 había mil doscientas personas, doscientas veintiún mil casas y veintiún libros a veintiún euros, "
     "doscientas libras; espera una hora y treinta y un minutos."),
    ("de", "In 1 Stunde, nach 1 Jahr, 1 Tasse, 1 l, 1 €; 1/2 Liter, 1/2 Stunde, 1 1/2 Liter, 21 Tage, um 1 Uhr",
     "In einer Stunde, nach einem Jahr, eine Tasse, ein Liter, ein Euro; ein halber Liter, eine halbe Stunde, "
     "anderthalb Liter, 21 Tage, um 1 Uhr"),
    ("pt-br", "2 pessoas, 2 000 pessoas, 2.500 casas e 2 livros às 21 horas: CPF 529.982.247-25",
     "duas pessoas, duas mil pessoas, duas mil e quinhentas casas e 2 livros às vinte e uma horas: "
     "CPF 5 2 9 9 8 2 2 4 7 2 5"),
    ("ru", "1 минута, 2 минуты, 1 минуту, 5 минут, 1 мин, 22 ч, 102 страницы, 1 яблоко, 2 раза, 1001 ночь",
     "одна минута, две минуты, одну минуту, 5 минут, одна минута, 22 часа, сто две страницы, одно яблоко, 2 раза, "
     "одна тысяча одна ночь"),
    ("it", "1 pagina, 1 libro, 1 km, 21 anni, il 1 maggio",
     "una pagina, un libro, un chilometro, 21 anni, il 1 maggio"),
    ("fr-fr", "1 page, 21 pages, 71 pages, 1 min, 21 ans, 101 personnes",
     "une page, vingt et une pages, 71 pages, une minute, 21 ans, cent une personnes"),
    ("pl", "2 kobiety, 22 strony, 1 minutę, 1 jabłko, 21 osób, 2 min, 2 domy",
     "dwie kobiety, dwadzieścia dwie strony, jedną minutę, jedno jabłko, 21 osób, dwie minuty, 2 domy"),
    ("en-us", "Due 2024-05-12 or 1990-01-31, not 2024-13-40; 05/12/2024.",
     "Due May twelfth, twenty twenty-four or January thirty-first, nineteen ninety, not 2024-13-40; 05/12/2024."),
    ("en-us", "Dr. Smith paid $3.50 for 21 oz. of soup on St. James St. at 4:30 p.m.",
     "Doctor Smith paid 3 dollars 50 for 21 ounces of soup on Saint James Street at 4:30 p.m."),
    ("en-us", "Chapter IV, fig. 2: 1/2 cup, 10°C, 5 km/h, 1990s, 50%.",
     "Chapter 4, figure 2: one half cup, 10 degrees Celsius, 5 kilometres per hour, nineteen nineties, 50%."),
    ("en-gb", "$3.5 million, $1, £0.99 in 1905, 5kg.",
     "3.5 million dollars, 1 dollar, 99 pence in nineteen oh-five, 5 kilograms."),
    ("en-us", "Mail 192.168.1.1 on 3/4/2026.", "Mail 192.168.1.1 on 3/4/2026."),
    ("en-us", "In 1990 sales rose, 1990 people, 1500 soldiers, a 1200 km road, 1800 555 0199, 1984a.",
     "In nineteen ninety sales rose, 1990 people, 1500 soldiers, a 1200 kilometre road, 1800 555 0199, 1984a."),
    ("en-us", "Mail a5m@5km.com or https://x.org/1990?x=5m, v1.5.3 km.",
     "Mail a5m@5km.com or https://x.org/1990?x=5m, v1.5.3 km."),
    ("en-us", "£1.5bn, $5M, $2-million, $20-30, -$5.",
     "1.5 billion pounds, 5 million dollars, 2-million dollars, 20 to 30 dollars, -5 dollars."),
    ("en-us", "To St. Petersburg on Elm St. The fig. It is the part I like. Is he? No. I am.",
     "To Saint Petersburg on Elm Street. The fig. It is the part I like. Is he? No. I am."),
    ("de", "Am 1. und 2. Mai, in der 2. Klasse um 8:00 Uhr. 5 Min. Dann 5 € 50, 0,50 CHF.",
     "Am ersten und zweiten Mai, in der zweiten Klasse um 8 Uhr. 5 Minuten. Dann 5 Euro 50, 50 Rappen."),
    ("de", "10-20 €, 1990 Leute, 1.2.3", "10 bis 20 Euro, 1990 Leute, 1.2.3"),
    ("fr-fr", "Mon vol. Il part à 8h00, vol. 3, $5-6, 100 av. J.-C., 06 12 34 56 78.",
     "Mon vol. Il part à 8 heures, volume 3, 5 à 6 dollars, 100 avant Jésus-Christ, 06 12 34 56 78."),
    ("fr-fr", "M. et Mme Roy", "monsieur et Mme Roy"),
    ("es", "1° de mayo, 30° y 30 ºC, 5 millones €", "primero de mayo, 30° y 30 grados Celsius, 5 millones de euros"),
    ("pt-br", "R$ 1.234,56; R$ 2 milhões; 1h30", "1.234 reais e 56;  2 milhões de reais; uma hora e 30"),
    ("cmn", "下午3:30开会，5mg，1,000%，12:30:45", "下午3点30分开会，5毫克，百分之1,000，12:30:45"),
    ("ja", "3分の1、¥500 500円", "3ぶんの1、500えん  500えん "),
    ("en-us", "It is 5 ft.", "It is 5 feet."),
    ("de", "Dr. Müller wohnt ca. 3,5 km entfernt, z.B. in der Königstr. 12.",
     "Doktor Müller wohnt zirka 3,5 Kilometer entfernt, zum Beispiel in der Königstraße 12."),
    ("de", "Am 3. Oktober 1990 um 8:15 Uhr.", "Am dritten Oktober neunzehnhundertneunzig um 8 Uhr 15."),
    ("de", "Der 3. Mai; 1990 Euro, 3,50 €. Er ist 3. Gut.", "Der dritte Mai; 1990 Euro, 3 Euro 50. Er ist 3. Gut."),
    ("fr-fr", "M. Roy, le 2e, à 8h15, 3,50 €, 1/2.", "monsieur Roy, le deuxième, à 8 heures 15, 3 euros 50, un demi."),
    ("es", "La 2.ª en el n.º 5, 3.er piso, 3,50 €.", "La segunda en el número 5, tercer piso, 3 euros con 50."),
    ("pt-br", "Às 15h30 do dia 1º, R$ 5,50, 1 km.", "Às 15 horas e 30 do dia primeiro, 5 reais e 50, 1 quilômetro."),
    ("ru", "В 1999 г. 25 %, т.е. 3 кг, 11 кг, 21 кг, 2,5 кг.",
     "В 1999 году 25 процентов, то есть 3 килограмма, 11 килограммов, 21 килограмм, 2,5 килограмма."),
    ("hi", "डॉ. शर्मा, ₹500, 1/2", "डॉक्टर शर्मा, 500 रुपये, आधा"),
    ("bn", "ড. রহমান ৳৫০০ ৫ কিমি", "ডক্টর রহমান ৫০০ টাকা ৫ কিলোমিটার"),
    ("ar", "5 كم", "5 كيلومتر"),
    ("id", "Rp 5.000 di Jl. Sudirman", "5.000 rupiah di Jalan Sudirman"),
    ("cmn", "2024年，25%，1/2，5km", "2 0 2 4 年，百分之25，二分之一，5公里"),
    ("ja", "5月3日、午後3時半。1人", "5がつ みっか 、ごご 3じはん 。ひとり "),
    ("sw", "ng'ombe", "ngombe"),
    ("de", "Ab 12.05.2024, am 24.12. und Mo-Fr 8-18 Uhr: 3:1, 1/2 l, -5 °C, 20 m², Ludwig II. von Bayern.",
     "Ab zwölften Mai zweitausendvierundzwanzig, am vierundzwanzigsten zwölften und Montag bis "
     "Freitag 8 bis 18 Uhr: 3 zu 1, "
     "ein halber Liter, minus 5 Grad Celsius, 20 Quadratmeter, Ludwig der zweite von Bayern."),
    ("de", "Tel. 0171 2345678, +49 30/123456; 31.12.99, 32.5.2024, 1.2.3 und 0 5", "Telefon 0 1 7 1 2 3 4 5 6 7 8, "
     "+4 9 3 0 1 2 3 4 5 6; 31.12.99, 32.5.2024, 1.2.3 und 0 5"),
    ("fr-fr", "Louis XIV, XVIIe siècle, François Ier, 850 €/mois, 2,3 M€, le 01/07/2023, 3/4 kg, -5 °C",
     "Louis 14, dix-septième siècle, François premier, 850 euros par mois, 2,3 millions d'euros, le 1er juillet 2023, "
     "trois quarts de kilo, moins 5 degrés Celsius"),
    ("es", "El lun. a las 8:00, 12/05/2024, Felipe II, Isabel II, s. XVI, km 12, 1 250 000 €, -5 °C.",
     "El lunes a las 8, 12 de mayo de 2024, Felipe segundo, Isabel segunda, siglo XVI, kilómetro 12, 1250000 euros, "
     "menos 5 grados Celsius."),
    ("pt-br", "D. Pedro II, séc. XIX, 7h15min, R$ 850/mês, (11) 91234-5678",
     "dom Pedro segundo, século 19, 7 horas e 15, 850 reais por mês, (1 1) 9 1 2 3 4 5 6 7 8"),
    ("ru", "12.05.2024, 3 июня, 1-й и 3-я, Пётр I и Екатерина II в XVIII веке, 1 250 000 м², 85 000 ₽, 3/4 кг, -5 °C",
     "двенадцатого мая две тысячи двадцать четвёртого года, третьего июня, первый и третья, Пётр "
     "первый и Екатерина вторая "
     "в восемнадцатом веке, 1250000 квадратных метров, 85000 рублей, три четверти килограмма, минус "
     "5 градусов Цельсия"),
    ("ru", "Екатерина II правила", "Екатерина вторая правила"),
    ("ru", "Пётр I правил", "Пётр первый правил"),
    ("ru", "21-е место", "двадцать первое место"),
    ("it", "Il Sig. Rossi, 2024-05-01, 1/2 l, 3/4 kg, 1 km/h, 850 €/mese, 21º piano, 3ª porta, tel. 06 1234567, -5 °C",
     "Il signor Rossi, primo maggio 2024, mezzo litro, tre quarti di chilo, un chilometro all'ora, 850 euro al mese, "
     "ventunesimo piano, terza porta, telefono 0 6 1 2 3 4 5 6 7, meno 5 gradi"),
    ("tr", "II. Mehmed 15. yüzyılda, Dr. Kaya, 45 m², 19,99 TL, 12.05.2024, saat 8:00",
     "ikinci Mehmed onbeşinci yüzyılda, doktor Kaya, 45 metrekare, 19 lira 99, 12 Mayıs 2024, saat 8"),
    ("pl", "Jan III w XVII w., 1 zł, 2 zł, 5 zł, 21 zł, 22 zł, 2,5 kg, 3 czerwca, 12.05.2024, o godz. 8:00",
     "Jan trzeci w siedemnastym wieku, 1 złoty, 2 złote, 5 złotych, 21 złotych, 22 złote, 2,5 "
     "kilograma, trzeciego czerwca, "
     "dwunastego maja dwa tysiące dwudziestego czwartego roku, o godzinie 8"),
    ("ja", "-5℃、3対1、6本、30分、80km/h、03-1234-5678", "マイナス5ど 、3たい1、"
     "ろっぽん 、さんじゅっぷん 、80キロまいじ 、"
     "0 3 1 2 3 4 5 6 7 8"),
    ("cmn", "57,000人，¥1250050，-5℃，3:1，8:00-18:00，"
     "13812345678", "5万7000人，125万零50元，负5摄氏度，3比1，8点到18点，"
     "1 3 8 1 2 3 4 5 6 7 8"),
    ("en-us", "Mon. at 8:00, 9:00 a.m., 8:00-18:00, 2-3 hrs, £850/month, 45 m², 3/4 kg, 1/2 lb, call 555-0199.",
     "Monday at 8 o'clock, 9 a.m., 8 o'clock to 18 o'clock, 2 to 3 hours, 850 pounds per month, 45 square metres, "
     "three quarters of a kilogram, one half pound, call 5 5 5 0 1 9 9."),
    ("en-gb", "Henry VIII, Louis XIV, Elizabeth II, Rocky II, +44 20 7946 0958, (212) 555-0199, 1-2-3",
     "Henry the 8th, Louis the 14th, Elizabeth the second, Rocky II, +4 4 2 0 7 9 4 6 0 9 5 8, (2 1 2) 5 5 5 0 1 9 9, "
     "1-2-3"),
    ("fr-fr", "5 €/h, n°5, 01.42.68.53.00, 3 ‰", "5 euros de l'heure, numéro 5, 01 42 68 53 00, 3 pour mille"),
    ("it", "5 €/ora, N. 5", "5 euro all'ora, numero 5"),
    ("es", "D. Juan y D.ª Ana", "don Juan y doña Ana"),
    ("ru", "90-е годы, 5 руб./час, в 8 ч. 15 мин.", "девяностые годы, 5 рублей в час, в 8 часов 15 минут."),
    ("pl", "tel. 22 123 45 67, 5 zł/godz., 50 gr", "telefon 2 2 1 2 3 4 5 6 7, 5 złotych za godzinę, 50 groszy"),
    ("ja", "7時半、10分間、2番目", "しちじはん 、じゅっぷんかん 、2ばんめ "),
    ("cmn", "2024/12/01，500元/月，10-20人，400-800-1234",
     "2 0 2 4 年12月1日，500元每月，10到20人，4 0 0 8 0 0 1 2 3 4"),
    ("hi", "-5", "माइनस 5"),
    ("ar", "-5", "ناقص 5"),
    ("de", "Im 2. Quartal, 5 €/Std., 3‰, geb. 1998", "Im zweiten Quartal, 5 Euro pro Stunde, 3 Promille, "
     "geboren neunzehnhundertachtundneunzig"),
    ("de", "Post an max.mueller@web.de oder www.bahn.de.",
     "Post an max Punkt mueller@web Punkt de oder www Punkt bahn Punkt de."),
    ("en-us", "From 1914-1918 to 2010–2015, in the '90s: 3:1, 9:05, 1:50, 1-800-555-0199, 11/28/2026, $5.01.",
     "From nineteen fourteen to nineteen eighteen to 2010 to 2015, in the nineties: 3 to 1, 9 oh 5, 1:50, "
     "1 8 0 0 5 5 5 0 1 9 9, November twenty-eighth, twenty twenty-six, 5 dollars 1 cent."),
    ("en-us", "Mt. Fuji, 5'10\", 2 tbsp, 0.25 s, 50p, 1080p, $20/unit, #1, 1.5x faster, 24/7, Genesis 1:3, Type II",
     "Mount Fuji, 5 foot 10, 2 tablespoons, 0.25 seconds, 50 pence, 1080p, 20 dollars per unit, number 1, "
     "1.5 times faster, 24 7, Genesis 1 3, Type 2"),
    ("de", "Der 1., 2. und 3. Preis, in der 1. und 2. Klasse, der 100. Kunde, vom 1.-3. Mai. Das war Platz 3. Danach.",
     "Der erste, zweite und dritte Preis, in der ersten und zweiten Klasse, der hundertste Kunde, vom ersten bis "
     "dritten Mai. Das war Platz 3. Danach."),
    ("de", "Maria II. kam, Kapitel XII, 1914–1918, um 20:00, 5x am Tag, 10 : 2, 0,25 s, 1,5 h, 2¼ kg, ½ TL",
     "Maria die zweite kam, Kapitel 12, neunzehnhundertvierzehn bis neunzehnhundertachtzehn, um 20 Uhr, 5 mal am Tag, "
     "10 geteilt durch 2, 0,25 Sekunden, 1,5 Stunden, 2 einviertel Kilogramm, ein halber Teelöffel"),
    ("fr-fr", "La IIe guerre, 9h-17h, 1½ c. à s., 42 s, Nº 7, 3 M d'habitants, 2016-2018. Le 11 s'est, en 2010 l'été.",
     "La deuxième guerre, 9 heures à 17 heures, une cuillère à soupe et demie, 42 secondes, numéro 7, "
     "3 millions d'habitants, 2016 à 2018. Le 11 s'est, en 2010 l'été."),
    ("es", "La II Guerra, el II Congreso, 1 perro, 200 chicas, 200 días, a la 1, a la 1:15, 1½ km/h, Gil & Hijos",
     "La segunda Guerra, el segundo Congreso, un perro, doscientas chicas, 200 días, a la una, a la una y 15, "
     "un kilómetro y medio por hora, Gil e Hijos"),
    ("it", "La II guerra, 1 mln di euro, 1½ cucchiai, 2½ km/h, 5 × 3, all'1, nel 2010 l'estate, 3,05 €",
     "La seconda guerra, un milione di euro, un cucchiaio e mezzo, 2 chilometri e mezzo all'ora, 5 per 3, all'una, "
     "nel 2010 l'estate, 3 euro e 5 centesimi"),
    ("pt-br", "A II Guerra, o II Congresso, século V, 12-15, 2010-2015, 22 alunas, 21 dias, 1½ km/h, 44 a.C. e 5",
     "A segunda Guerra, o segundo Congresso, século 5, 12 a 15, 2010 a 2015, vinte e duas alunas, 21 dias, "
     "1 quilômetro e meio por hora, 44 antes de Cristo e 5"),
    ("hi", "1½ km/h, 3½ kg, 2¼ kg, 3¾ km, 1¼, -½ °C",
     "डेढ़ किलोमीटर प्रति घंटा, साढ़े 3 किलोग्राम, सवा 2 किलोग्राम, 3 सही तीन बटा चार किलोमीटर, सवा, "
     "माइनस आधा डिग्री सेल्सियस"),
    ("bn", "1½ km/h, 3½ kg, 2¼", "দেড় কিলোমিটার প্রতি ঘণ্টা, সাড়ে 3 কেজি, সোয়া 2"),
    ("sw", "1½ km/h, 2¼ kg, 5km, 50%", "kilomita kwa saa 1 na nusu, kilo 2 na robo, kilomita 5, asilimia 50"),
    ("tr", "2¼ kg, 1½ km/h", "2 tam bir bölü dört kilogram, 1 buçuk kilometre bölü saat"),
    ("nl", "3,50 €, 5 km", "3,50 €, 5 km"),  # has no table
]  # fmt: skip


@pytest.mark.parametrize(("code", "text", "expected"), CASES)
def test_what_is_said(code: str, text: str, expected: str) -> None:
    assert spoken_form(text, code).text == expected


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_table_can_be_read_and_replaces_its_own_entries(language: str) -> None:
    table = tomllib.loads((files("fapengine.voices") / "spoken" / f"{language}.toml").read_text("utf-8"))
    texts, tables = (
        {
            "price",
            "scales",
            "of",
            "starters",
            "spaced",
            "minus",
            "share",
            "phones",
            "joined",
            "dot",
            "to",
            "elides",
            "unit_first",
            "one_after",
        },
        {"short_scales", "cents"},
    )
    parts = {"words", "units", "currencies", "fractions", "mixed", "rules", "patterns", "date", "gender"}
    assert set(table) <= texts | tables | parts
    assert "½" not in spoken_form("½", language).text
    assert _rules(language)
    assert not [rule for rule in _rules(language) if re.search(r"\{[a-z_]+\}", rule.pattern.pattern)]
    for key in table.get("words", {}):
        assert key not in spoken_form(f"5: {key} ", language).text.split()
    for key in table.get("units", {}):
        assert spoken_form(f" 12 {key} ", language).text.split()[-1] != key
    for key in table.get("currencies", {}):
        assert not re.search(rf"{re.escape(key)}(?![^\W\d])", spoken_form(f" {key}5 ", language).text)


@pytest.mark.parametrize(("code", "text", "_"), CASES)
def test_places_never_fall_and_cover_the_text(code: str, text: str, _: str) -> None:
    said = spoken_form(text, code)
    assert len(said.text) == len(said.starts) == len(said.stops)
    assert list(said.starts) == sorted(said.starts)
    assert list(said.stops) == sorted(said.stops)
    assert all(0 <= start < stop <= len(text) for start, stop in zip(said.starts, said.stops, strict=True))


def spoken(text: str, code: str = "en-us", *, ssml: bool = False) -> list[str]:
    track = EspeakVoice(code, ssml=ssml).speak(text).phones
    return list(dict.fromkeys(word for word, _, _ in words_of(track.phones)))  # a pause in a word is between two halves


def test_words_are_those_of_the_text() -> None:
    text = "Dr. Lee paid $3.5 million on James St. in the 1990s."
    assert spoken(text) == ["Dr", "Lee", "paid", "$3.5", "million", "on", "James", "St", "in", "the", "1990s"]
    assert spoken("Es kostet 3,50 € um 8:15 Uhr.", "de") == ["Es", "kostet", "3,50", "€", "um", "8:15", "Uhr"]
    assert spoken("Ruf 0171 2345678 an, am 12.05.2024, www.bahn.de.", "de") == [
        "Ruf", "0171", "2345678", "an", "am", "12.05.2024", "www.bahn.de"
    ]  # fmt: skip
    assert spoken("São R$ 5,50 hoje.", "pt-br") == ["São", "R$", "5,50", "hoje"]


def test_marks_stand_where_they_stood() -> None:
    speech = EspeakVoice("en-us").speak("It costs $3.50 [smile] for 5 km [nod] today.")
    times = {word: start_s for word, start_s, _ in words_of(speech.phones.phones)}
    assert [mark.at_s for mark in speech.marks] == [times["for"], times["today"]]


def test_ssml_keeps_its_tags_and_what_they_say_themselves() -> None:
    text = '<speak>Pay <emphasis level="5 km">$3.50</emphasis>, <say-as interpret-as="date">5 km</say-as>.</speak>'
    assert spoken_form(text, "en-us").text == text.replace("$3.50", "3 dollars 50")
    assert spoken(text, ssml=True)[:2] == ["Pay", "$3.50"]


def test_words_that_are_spelled_are_remarked_on() -> None:
    remarks = EspeakVoice("de").speak("Der Antrag bspw. TV, 5 km.").remarks
    assert remarks == ("text: 'bspw' (letter 12) spoken letter by letter; write out what is meant",)
    assert EspeakVoice("fr-fr").speak("Voir www.sncf.com.").remarks == ()
    assert EspeakVoice("cs").speak("Strč prst skrz krk.").remarks == ()
    assert EspeakVoice("ja").speak("2024年5月3日、午後3時半。").remarks == ()
    assert "'漢字'" in EspeakVoice("ja").speak("2024年の 漢字").remarks[0]


def test_tables_are_loaded_when_they_are_used() -> None:
    program = (
        "import sys; from fapengine.voices.espeak import EspeakVoice; EspeakVoice().speak({!r});"
        "from fapengine.voices.spoken_form import _rules as of;"
        "print(of.cache_info().currsize, 'num2words' in sys.modules)"
    )
    for text, expected in (
        ("Hello there, it's a sentence.", "0 False"),
        ("It is 5 km.", "1 False"),
        ("In 1990.", "1 True"),
    ):
        done = subprocess.run([sys.executable, "-c", program.format(text)], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == expected


def test_entities_of_ssml_do_not_shift_words() -> None:
    text = 'R&amp;D &amp; AT&amp;T, &lt; <emphasis>$3.50</emphasis> &quot;is&quot; <mark name="nod"/> today.'
    speech = EspeakVoice("en-us", ssml=True).speak(text)
    words = {word: start_s for word, start_s, _ in words_of(speech.phones.phones)}
    assert list(words) == ["R&D", "&", "AT&T", "$3.50", "is", "today"]
    assert speech.marks[-1].at_s == words["today"]
